"""Reads --tensorboard's event files as TensorBoard does, with none of the project's code."""

import csv
import struct
import unittest

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from server import trained_server

# tensorboard/compat/proto/event.proto and summary.proto: (name, number, type) of the fields used.
FIELD = descriptor_pb2.FieldDescriptorProto
SCHEMA = {
    "Value": [("tag", 1, FIELD.TYPE_STRING), ("simple_value", 2, FIELD.TYPE_FLOAT)],
    "Summary": [("value", 1, "Value")],
    "Event": [("wall_time", 1, FIELD.TYPE_DOUBLE), ("step", 2, FIELD.TYPE_INT64),
              ("file_version", 3, FIELD.TYPE_STRING), ("summary", 5, "Summary")]}


def event_class():
    """Returns the class of TensorBoard's Event."""
    file = descriptor_pb2.FileDescriptorProto(name="event.proto", package="read", syntax="proto3")
    for name, fields in SCHEMA.items():
        message = file.message_type.add(name=name)
        for field, number, kind in fields:
            added = message.field.add(name=field, number=number, label=FIELD.LABEL_OPTIONAL)
            if isinstance(kind, str):
                added.type, added.type_name = FIELD.TYPE_MESSAGE, f".read.{kind}"
            else:
                added.type = kind
    file.message_type[1].field[0].label = FIELD.LABEL_REPEATED
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.MessageFactory(pool).GetPrototype(pool.FindMessageTypeByName("read.Event"))


def masked_crc(data):
    """Returns the checksum of TFRecord: CRC-32C (RFC 3720), bit by bit, rotated and shifted."""
    crc = 0xffffffff
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82f63b78 if crc & 1 else 0)
    crc ^= 0xffffffff
    return ((crc >> 15 | crc << 17) + 0xa282ead8) & 0xffffffff


def records(data):
    """Yields the records of a TFRecord file: length, its checksum, the bytes, their checksum."""
    while data:
        length, of_length = struct.unpack("<QI", data[:12])
        assert of_length == masked_crc(data[:8]), "checksum of a length"
        record, (of_record,) = data[12:12 + length], struct.unpack("<I", data[12 + length:][:4])
        assert len(record) == length and of_record == masked_crc(record), "checksum of a record"
        yield record
        data = data[16 + length:]


class TensorBoardTest(unittest.TestCase):

    def test_reads_the_figures_that_the_csv_has(self):
        server = trained_server()
        job = server.job.name.split("/")[1]
        server.maneuver("job", "report", job, "--curves", "curves.csv", "--tensorboard", "runs")
        Event = event_class()
        read = {}
        for run in ("training", "held-out", "mixture"):
            (file,) = (server.folder / "runs" / run).iterdir()
            self.assertIn("tfevents", file.name, "TensorBoard finds files by this word")
            opening, *events = map(Event.FromString, records(file.read_bytes()))
            self.assertEqual(opening.file_version, "brain.Event:2")
            for event in events:
                started, ended = server.job.start_time.seconds, server.job.end_time.seconds
                self.assertTrue(started <= event.wall_time <= ended + 1, event.wall_time)
                for value in event.summary.value:
                    read[run, value.tag, event.step] = value.simple_value
        with open(server.folder / "curves.csv", newline="") as file:
            written = {(row["examples"], f"{row['phase']}/{row['term']}", int(row["step"])):
                       float(row["value"]) for row in csv.DictReader(file)}
        self.assertIn("joint/loss", {tag for _, tag, _ in written})
        self.assertEqual(read.keys(), written.keys())
        for key, value in written.items():
            self.assertAlmostEqual(read[key], value, delta=1e-5 * max(1.0, abs(value)), msg=key)


if __name__ == "__main__":
    unittest.main()
