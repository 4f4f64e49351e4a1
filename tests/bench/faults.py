#!/usr/bin/python3
"""Callers who do what they should not, against a server in plain text on this machine.

faults.py ADDRESS FAULT SECONDS: goes on for so long (half-open: until the server has closed them), then says as one line of JSON what became of them.

  message     messages of 300 MB, one after another
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

import grpc

SERVICE = "/maneuver.v1.PredictionService/"
PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0\4\0\0\0\0\0"  # and no settings


def count(ended, error):
    code = "OK" if error is None else error.code().name
    ended[code] = ended.get(code, 0) + 1


def large(address, until, compression):
    """Calls Predict with 300 MB, in a connection of its own each."""
    ended, body = {}, b"\x0a\xff\xff\xff\x7f" + b"x" * (300 << 20)
    while not ended or time.time() < until:
        with grpc.insecure_channel(address, options=[("grpc.max_send_message_length", -1)],
                                   compression=compression) as channel:
            try:
                channel.unary_unary(SERVICE + "Predict")(body, timeout=60)
                count(ended, None)
            except grpc.RpcError as error:
                count(ended, error)
    return {"ended": ended}


def connect(address):
    host, port = address.rsplit(":", 1)
    return socket.create_connection((host, int(port)))


def frame(kind, flags, stream, payload):
    return struct.pack(">I", len(payload))[1:] + bytes([kind, flags]) + struct.pack(">I", stream) + payload


def header(name, value):
    return b"\0" + bytes([len(name)]) + name + bytes([len(value)]) + value


def talk(connection, until, answers):
    """Answers what HTTP/2 has to be answered, and counts frames of data."""
    unread = b""
    connection.settimeout(0.2)
    while time.time() < until:
        try:
            received = connection.recv(1 << 16)
        except socket.timeout:
            continue
        if not received:
            answers["closed"] += 1
            return
        unread += received
        while len(unread) >= 9:
            length = int.from_bytes(unread[:3], "big")
            if len(unread) < 9 + length:
                break
            kind, flags, payload = unread[3], unread[4], unread[9:9 + length]
            unread = unread[9 + length:]
            answers["data"] += kind == 0 and length > 0
            if kind == 4 and not flags & 1:
                connection.sendall(frame(4, 1, 0, b""))
            if kind == 6 and not flags & 1:
                connection.sendall(frame(6, 1, 0, payload))


def streams(address, until):
    headers = b"".join(header(*pair) for pair in (
        (b":method", b"POST"), (b":scheme", b"http"), (b":path", (SERVICE + "StreamPredict").encode()),
        (b":authority", b"localhost"), (b"te", b"trailers"), (b"content-type", b"application/grpc")))
    answers = {"data": 0, "closed": 0}
    threads = []
    for _ in range(25):
        connection = connect(address)
        calls = b"".join(frame(1, 4, i, headers) + frame(0, 0, i, b"\0" * 5) for i in range(1, 401, 2))
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
        "message": lambda: large(address, until, None),
        "bomb": lambda: large(address, until, grpc.Compression.Gzip),
        "streams": lambda: streams(address, until),
        "half-open": lambda: half_open(address, until),
        "slow": lambda: slow(address, until),
    }
    print(json.dumps(faults[fault]()))


if __name__ == "__main__":
    main()
