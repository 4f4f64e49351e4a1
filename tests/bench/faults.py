#!/usr/bin/python3
"""Callers who do what they should not, against a server in plain text on this machine.

faults.py ADDRESS FAULT SECONDS: goes on for so long (message: a single one, halfway; half-open: until the
server has closed them), then says as one line of JSON what became of them.

  message     one message of 300 MB
  messages    messages of 300 MB, one after another
  bomb        300 kB that would unpack to 300 MB
  streams     5,000 StreamPredict streams over 25 connections, a request on each
  half-open   200 connections that say nothing, half of them after the first words of HTTP/2
  slow        64 streams that send requests and never read an answer

Needs python3-grpcio, as Debian has it.
"""

import json
import socket
import struct
import sys
import threading
import time
import zlib

import grpc

SERVICE = "/maneuver.v1.PredictionService/"
LARGE = 300 << 20
PIECE = 1 << 14
CODES = {code.value[0]: code.name for code in grpc.StatusCode}
PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0\4\0\0\0\0\0"  # and no settings


def count(ended, error):
    code = "OK" if error is None else error.code().name
    ended[code] = ended.get(code, 0) + 1


def connect(address):
    host, port = address.rsplit(":", 1)
    return socket.create_connection((host, int(port)))


def frame(kind, flags, stream, payload):
    return struct.pack(">I", len(payload))[1:] + bytes([kind, flags]) + struct.pack(">I", stream) + payload


def header(name, value):
    return b"\0" + bytes([len(name)]) + name + bytes([len(value)]) + value


def headers(method, *more):
    return b"".join(header(*pair) for pair in (
        (b":method", b"POST"), (b":scheme", b"http"), (b":path", (SERVICE + method).encode()),
        (b":authority", b"localhost"), (b"te", b"trailers"), (b"content-type", b"application/grpc"), *more))


def frames(connection, unread, received):
    """Those that are whole in what was received: kind, flags, stream and payload of each.

    Answers what HTTP/2 has to be answered. What is left stays in `unread`, a bytearray.
    """
    unread += received
    while len(unread) >= 9:
        length = int.from_bytes(unread[:3], "big")
        if len(unread) < 9 + length:
            break
        kind, flags, stream, payload = unread[3], unread[4], int.from_bytes(unread[5:9], "big"), bytes(unread[9:9 + length])
        del unread[:9 + length]
        if kind in (4, 6) and not flags & 1:
            connection.sendall(frame(kind, 1, 0, payload if kind == 6 else b""))
        yield kind, flags, stream, payload


def talk(connection, until, answers):
    """Counts frames of data."""
    unread = bytearray()
    connection.settimeout(0.2)
    while time.time() < until:
        try:
            received = connection.recv(1 << 16)
        except socket.timeout:
            continue
        if not received:
            answers["closed"] += 1
            return
        answers["data"] += sum(kind == 0 and len(payload) > 0 for kind, _, _, payload in frames(connection, unread, received))


def status_of(kind, payload):
    """Of a call, from a frame; None if that does not end it."""
    at = payload.find(b"grpc-status") if kind == 1 else -1
    if at >= 0:  # a literal: its name, the length of its value, and that
        return CODES[int(payload[at + 12:at + 12 + payload[at + 11]])]
    return {3: "reset", 7: "closed"}.get(kind)


def call_predict(address, size, pieces, *more):
    """Calls Predict with `size` bytes, as they are in `pieces` (of 16 KiB) again and again, as fast as the server's windows
    allow. Says how that ended.

    gRPC's Python would hold the message three times, and so much new memory slows the whole machine down, which is none
    of the server's doing.
    """
    block, many = memoryview(b"".join(frame(0, 0, 1, piece) for piece in pieces)), len(pieces)
    connection, unread, status = connect(address), bytearray(), None
    prefix = (b"\1" if more else b"\0") + struct.pack(">I", size)
    connection.sendall(PREFACE + frame(1, 4, 1, headers("Predict", *more)) + frame(0, 0, 1, prefix))
    initial, left = 65535, size
    windows = {stream: initial - len(prefix) for stream in (0, 1)}
    while status is None:
        count = min(*windows.values(), left) // PIECE
        if count > 0:
            count = min(count, many)
            connection.sendall(block[:count * (PIECE + 9)])
            windows = {stream: window - count * PIECE for stream, window in windows.items()}
            left -= count * PIECE
        connection.settimeout(0 if count > 0 else 30)
        try:
            received = connection.recv(1 << 16)
        except BlockingIOError:
            continue
        except OSError as error:
            return type(error).__name__
        finally:
            connection.settimeout(30)
        if not received:
            return "closed"
        for kind, flags, stream, payload in frames(connection, unread, received):
            status = status or status_of(kind, payload)
            if kind == 8:
                windows[stream] += int.from_bytes(payload, "big")
            if kind == 4 and not flags & 1:
                for i in range(0, len(payload), 6):
                    key, value = struct.unpack(">HI", payload[i:i + 6])
                    if key == 4:
                        windows[1] += value - initial
                        initial = value
    connection.close()
    return status


def send_large(address):
    return call_predict(address, LARGE, [b"x" * PIECE] * 64)


def message(address, until):
    time.sleep(max(0, (until - time.time()) / 2))
    return {"ended": {send_large(address): 1}}


def again_and_again(until, call):
    ended = {}
    while not ended or time.time() < until:
        status = call()
        ended[status] = ended.get(status, 0) + 1
    return {"ended": ended}


def bomb(address, until):
    packer = zlib.compressobj(9, wbits=31)
    packed = b"".join(packer.compress(bytes(PIECE)) for _ in range(LARGE // PIECE)) + packer.flush()
    packed += bytes(-len(packed) % PIECE)
    pieces = [packed[i:i + PIECE] for i in range(0, len(packed), PIECE)]
    return again_and_again(until, lambda: call_predict(address, len(packed), pieces, (b"grpc-encoding", b"gzip")))


def streams(address, until):
    answers = {"data": 0, "closed": 0}
    threads = []
    for _ in range(25):
        connection = connect(address)
        calls = b"".join(frame(1, 4, i, headers("StreamPredict")) + frame(0, 0, i, b"\0" * 5) for i in range(1, 401, 2))
        connection.sendall(PREFACE + calls)
        threads.append(threading.Thread(target=talk, args=(connection, until, answers)))
        threads[-1].start()
    for thread in threads:
        thread.join()
    return {"answered": answers["data"], "connections closed": answers["closed"]}


def half_open(address, until):
    connections = [connect(address) for _ in range(200)]
    for connection in connections[::2]:
        connection.sendall(PREFACE)
    closed, begin = [], time.time()
    while time.time() < max(until, begin + 15) and connections:
        time.sleep(0.1)
        for connection in list(connections):
            connection.setblocking(False)
            try:
                gone = not connection.recv(1 << 16)
            except BlockingIOError:
                gone = False
            except ConnectionError:
                gone = True
            if gone:
                closed.append(time.time() - begin)
                connections.remove(connection)
    return {"closed": len(closed), "after seconds": round(max(closed, default=0), 1), "left": len(connections)}


def slow(address, until):
    """Sends requests without a scene, which are answered by an error each, and reads none.

    Its windows stay at 64 KiB: gRPC's Python would widen them to megabytes for what nobody reads, which
    makes it a flood of requests. (That is for --rate-limit.)
    """
    sent, ended, calls = [0], {}, []
    lock = threading.Lock()
    message = b"\x0a\x80\x01" + b"i" * 128  # its id, which comes back

    def requests():
        while time.time() < until:
            with lock:
                sent[0] += 1
            yield message

    channel = grpc.insecure_channel(address, options=[("grpc.http2.bdp_probe", 0)])
    method = channel.stream_stream(SERVICE + "StreamPredict")
    for _ in range(64):
        calls.append(method(requests(), timeout=max(0.1, until - time.time())))
    for call in calls:
        count(ended, call if call.code() != grpc.StatusCode.OK else None)
    channel.close()
    return {"sent": sent[0], "ended": ended}


def main():
    address, fault, until = sys.argv[1], sys.argv[2], time.time() + float(sys.argv[3])
    faults = {
        "message": lambda: message(address, until),
        "messages": lambda: again_and_again(until, lambda: send_large(address)),
        "bomb": lambda: bomb(address, until),
        "streams": lambda: streams(address, until),
        "half-open": lambda: half_open(address, until),
        "slow": lambda: slow(address, until),
    }
    print(json.dumps(faults[fault]()))


if __name__ == "__main__":
    main()
