"""HTTP/2 frames by hand (RFC 9113), and a connection that sends them without any of a client's manners."""

import select
import socket
import ssl
import struct
import time

DATA, HEADERS, PRIORITY, RST_STREAM, SETTINGS, PING, GOAWAY, WINDOW_UPDATE, CONTINUATION = 0, 1, 2, 3, 4, 6, 7, 8, 9
ACK = END_STREAM = 1
END_HEADERS = 4
CANCEL = 8
INITIAL_WINDOW_SIZE = 4  # a setting
PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
ERRORS = ("NO_ERROR", "PROTOCOL_ERROR", "INTERNAL_ERROR", "FLOW_CONTROL_ERROR", "SETTINGS_TIMEOUT", "STREAM_CLOSED",
          "FRAME_SIZE_ERROR", "REFUSED_STREAM", "CANCEL", "COMPRESSION_ERROR", "CONNECT_ERROR", "ENHANCE_YOUR_CALM",
          "INADEQUATE_SECURITY", "HTTP_1_1_REQUIRED")


def frame(kind, flags, stream, payload=b""):
    return struct.pack(">I", len(payload))[1:] + bytes([kind, flags]) + struct.pack(">I", stream) + payload


def _integer(value, prefix_bits):
    """RFC 7541, 5.1, with zeros above the prefix."""
    most = (1 << prefix_bits) - 1
    if value < most:
        return bytes([value])
    result, value = bytearray([most]), value - most
    while value >= 128:
        result.append(value % 128 | 128)
        value //= 128
    result.append(value)
    return bytes(result)


def header(name, value, remember=False):
    """A literal header (RFC 7541, 6.2); the peer keeps it in its dynamic table if told to `remember` it."""
    kind = b"\x40" if remember else b"\x00"
    return kind + _integer(len(name), 7) + name + _integer(len(value), 7) + value


def call_headers(path, *more):
    """The header block of a gRPC call."""
    return b"".join([header(b":method", b"POST"), header(b":scheme", b"http"), header(b":path", path),
                     header(b":authority", b"localhost"), header(b"te", b"trailers"),
                     header(b"content-type", b"application/grpc"), *more])


def message(payload, declared=None):
    """A gRPC message; `declared`: the length that its prefix promises."""
    return b"\x00" + struct.pack(">I", len(payload) if declared is None else declared) + payload


class Connection:
    """A TCP connection from `source`, over TLS if `authority` is given. When the peer closes it, `closed` becomes true.

    Without `reads` it does not read until wait_for_end(), so that the peer's answers pile up. It stops sending at
    `give_up`, a time of time.monotonic().
    """

    def __init__(self, address, source, give_up, authority=None, greet=True, reads=True):
        host, port = address.rsplit(":", 1)
        self.reads = reads
        self.closed = False
        self.goaway = None  # name of the error
        self.ended_calls = 0  # that the peer answered or reset
        self.sent_bytes = 0
        self.received_bytes = 0
        self._give_up = give_up
        self._unread = b""
        try:
            self._socket = socket.create_connection((host, int(port)), timeout=2, source_address=(source, 0))
            if authority:
                context = ssl.create_default_context(cafile=authority)
                context.set_alpn_protocols(["h2"])
                self._socket = context.wrap_socket(self._socket, server_hostname=host)
        except OSError:  # refused, or closed during the handshake
            self.closed = True
            return
        self._socket.setblocking(False)
        if greet:
            self.send(PREFACE + frame(SETTINGS, 0, 0))

    def send(self, data):
        """Sends `data`. Returns false if the peer closed the connection, or time was up, before all was sent."""
        data = memoryview(data)
        while data and not self.closed:
            left = self._give_up - time.monotonic()
            if left <= 0:
                return False
            try:
                count = self._socket.send(data)
                self.sent_bytes += count
                data = data[count:]
            except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
                self._wait(select.POLLOUT | (select.POLLIN if self.reads else 0), min(left, 0.1))
                if not self.reads and self._was_reset():
                    self.closed = True
            except OSError:
                self.closed = True
                self.drain()  # a GOAWAY may have arrived before the end
                return False
            if self.reads:
                self.drain()
        return not self.closed

    def wait_for_end(self, until):
        """Reads until the peer closes the connection. Returns whether it did so before `until`."""
        while not self.closed and time.monotonic() < until:
            self._wait(select.POLLIN, min(0.1, until - time.monotonic()))
            self.drain()
        return self.closed

    def close(self):
        if hasattr(self, "_socket"):
            self._socket.close()

    def _wait(self, events, seconds):
        """Not by select, which knows no descriptors above 1,023."""
        poll = select.poll()
        poll.register(self._socket, events)
        poll.poll(1000 * max(0, seconds))

    def _was_reset(self):
        """Returns whether the peer has reset a connection that nobody reads."""
        return self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) != 0

    def drain(self):
        """Reads what has arrived."""
        try:
            while True:
                data = self._socket.recv(1 << 16)
                if not data:
                    self.closed = True
                    return
                self.received_bytes += len(data)
                self._look_at_frames(data)
        except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
            pass
        except OSError:
            self.closed = True

    def _look_at_frames(self, data):
        self._unread += data
        while len(self._unread) >= 9:
            length = int.from_bytes(self._unread[:3], "big")
            if len(self._unread) < 9 + length:
                return
            kind, flags = self._unread[3:5]
            self.ended_calls += kind == RST_STREAM or kind == HEADERS and bool(flags & END_STREAM)
            if kind == GOAWAY:
                error = int.from_bytes(self._unread[13:17], "big")
                self.goaway = ERRORS[error] if error < len(ERRORS) else str(error)
            self._unread = self._unread[9 + length:]
