#!/usr/bin/python3
"""Writes the seeds of the harnesses whose inputs are bytes: corpus/*. Text seeds are files of their own.

    tests/fuzz/make_corpus.py           needs protoc and python3-protobuf
"""

import importlib
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parent.parent


def generated(protos):
    """Imports the messages of the protos, compiled into a folder that is gone afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        for path, files in protos.items():
            subprocess.run(["protoc", f"--proto_path={path}", f"--proto_path={SOURCE / 'proto'}",
                            f"--python_out={folder}", *files], check=True, cwd=path)
        sys.path.insert(0, folder)
        names = ["maneuver.v1.prediction_service_pb2", "maneuver.v1.scenario_pb2",
                 "maneuver.v1.training_settings_pb2", "waymo_scenario_pb2", "shard_index_pb2",
                 "tag_files_pb2", "stream_script_pb2"]
        return [importlib.import_module(name) for name in names]


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def masked(data):
    crc = crc32c(data)
    return (crc >> 15 | crc << 17 & 0xFFFFFFFF) + 0xA282EAD8 & 0xFFFFFFFF


def record(payload):
    length = struct.pack("<Q", len(payload))
    return length + struct.pack("<I", masked(length)) + payload + struct.pack("<I", masked(payload))


def write(harness, name, data):
    folder = HERE / "corpus" / harness
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data)


def add_agent(scenario, number, kind, x, y, speed, steps=7, after=0):
    agent = scenario.agents.add(id=number, type=kind, length=4.5, width=1.9)
    for step in range(steps + after):
        time = (step - steps + 1) * 0.25 + scenario.prediction_time
        agent.states.add(time=time, x=x + speed * time, y=y, heading=0.02 * step, velocity_x=speed)


def add_line(scenario, number, kind, points, successors=(), limit=0.0):
    scenario.map_features.add(id=number, type=kind, x=[p[0] for p in points], y=[p[1] for p in points],
                              successor_ids=successors, speed_limit=limit)


def scenes(pb):
    """A fork with a leader, a signal and a stop sign; a pedestrian alone; a ring of lanes."""
    fork = pb.Scenario(scenario_id="fork", prediction_time=1.0, target_ids=[7, 8])
    add_agent(fork, 7, pb.AGENT_TYPE_VEHICLE, 100, 50, 7, after=14)
    add_agent(fork, 8, pb.AGENT_TYPE_VEHICLE, 115, 50.3, 5)
    add_agent(fork, 9, pb.AGENT_TYPE_PEDESTRIAN, 110, 55, 1)
    lane = pb.MAP_FEATURE_TYPE_LANE_CENTERLINE
    add_line(fork, 1, lane, [(40, 50), (80, 50), (112, 50)], [2, 3], 13.9)
    add_line(fork, 2, lane, [(112, 50), (142, 50), (200, 50)])
    add_line(fork, 3, lane, [(112, 50), (117, 51), (121, 55), (122, 60), (122, 110)])
    add_line(fork, 4, pb.MAP_FEATURE_TYPE_STOP_SIGN, [(113, 48)])
    add_line(fork, 5, pb.MAP_FEATURE_TYPE_CROSSWALK, [(118, 46), (121, 46), (121, 54), (118, 54)])
    signal = fork.traffic_signals.add(lane_id=2)
    signal.readings.add(time=0.5, state=pb.TRAFFIC_SIGNAL_STATE_STOP)
    walk = pb.Scenario(scenario_id="walk", prediction_time=0.5, target_ids=[1])
    add_agent(walk, 1, pb.AGENT_TYPE_PEDESTRIAN, 0, 0, 1.4)
    ring = pb.Scenario(scenario_id="ring", prediction_time=1.0, target_ids=[1])
    add_agent(ring, 1, pb.AGENT_TYPE_CYCLIST, 9, 0, 4, after=14)
    corners = [(10, 0), (0, 10), (-10, 0), (0, -10)]
    for i, corner in enumerate(corners):
        add_line(ring, i + 1, lane, [corner, corners[(i + 1) % 4]], [(i + 1) % 4 + 1])
    return {scene.scenario_id: scene for scene in (fork, walk, ring)}


def write_waymo(pb):
    scene = pb.Scenario(scenario_id="seed", timestamps_seconds=[0.1 * i for i in range(12)], current_time_index=10)
    for number in (3, 4):
        track = scene.tracks.add(id=number, object_type=1)
        for step in range(12):
            track.states.add(center_x=10.0 * number + step, center_y=2.0, length=4, width=2, heading=0.1,
                             velocity_x=10, velocity_y=0, valid=step % 5 != 4)
    scene.tracks_to_predict.add(track_index=0)
    lane = scene.map_features.add(id=5).lane
    lane.entry_lanes.append(5)
    lane.exit_lanes.append(6)
    for i in range(3):
        lane.polyline.add(x=10.0 * i, y=2.0)
    scene.map_features.add(id=6).stop_sign.position.x = 30.0
    for _ in range(12):
        scene.dynamic_map_states.add().lane_states.add(lane=5, state=4)
    write("waymo", "two-tracks", scene.SerializeToString())


def sections(files):
    """Several files as one input: each behind a line with its name."""
    return "".join(f"@{name}\n{content}" + ("" if content.endswith("\n") else "\n")
                   for name, content in files.items()).encode()


def write_nuscenes():
    """A car and a bicycle beside the recording car, on two lanes with a divider, a crossing and a stop line."""
    upright = [1, 0, 0, 0]
    samples = range(4)
    tables = {
        "log": [{"token": "l", "logfile": "n001", "location": "toy-town"}],
        "scene": [{"token": "s", "name": "scene-1", "log_token": "l", "nbr_samples": len(samples)}],
        "sample": [{"token": f"s{i}", "scene_token": "s", "timestamp": 500_000 * i} for i in samples],
        "category": [{"token": "c", "name": "vehicle.car"}, {"token": "b", "name": "vehicle.bicycle"}],
        "attribute": [{"token": "r", "name": "cycle.without_rider"}],
        "instance": [{"token": f"i{name}", "category_token": name, "nbr_annotations": len(samples)} for name in "cb"],
        "sensor": [{"token": "lidar", "channel": "LIDAR_TOP"}],
        "calibrated_sensor": [{"token": "k", "sensor_token": "lidar"}],
        "sample_data": [{"sample_token": f"s{i}", "calibrated_sensor_token": "k", "ego_pose_token": f"p{i}"}
                        for i in samples],
        "sample_annotation": [
            {"sample_token": f"s{i}", "instance_token": f"i{name}", "translation": [10 + speed * i, y, 1],
             "size": [2, 4, 1], "rotation": upright, "attribute_tokens": ["r"] if name == "b" else []}
            for name, speed, y in (("c", 5, 3.5), ("b", 0, -2)) for i in samples],
        "ego_pose": [{"token": f"p{i}", "timestamp": 500_000 * i, "rotation": upright, "translation": [4 * i, 0, 0]}
                     for i in samples],
    }
    places = {"d1": (0, 2), "d2": (50, 2), "a1": (0, -2), "a2": (50, -2), "a3": (50, 6)}
    segments = [{"node_token": name, "segment_type": "SINGLE_SOLID_WHITE"} for name in ("d1", "d2")]

    def path(x, y, length):
        return {"start_pose": [x, y, 0], "end_pose": [x + length, y, 0], "shape": "LSR", "radius": 9,
                "segment_length": [0, length, 0]}

    city = {
        "node": [{"token": name, "x": x, "y": y} for name, (x, y) in places.items()],
        "line": [{"token": "line", "node_tokens": ["d1", "d2"]}],
        "polygon": [{"token": "area", "exterior_node_tokens": ["a1", "a2", "a3"], "holes": []}],
        "lane": [{"token": "one", "lane_type": "CAR", "left_lane_divider_segments": segments,
                  "right_lane_divider_segments": []},
                 {"token": "two", "lane_type": "BIKE", "left_lane_divider_segments": [],
                  "right_lane_divider_segments": segments}],
        "lane_connector": [{"token": "on"}],
        "lane_divider": [{"token": "d", "line_token": "line", "lane_divider_segments": segments}],
        "ped_crossing": [{"token": "z", "polygon_token": "area"}],
        "stop_line": [{"token": "t", "polygon_token": "area"}],
        "drivable_area": [{"token": "w", "polygon_tokens": ["area"]}],
        "connectivity": {"one": {"incoming": [], "outgoing": ["on"]}, "on": {"incoming": ["one"], "outgoing": []}},
        "arcline_path_3": {"one": [path(0, 0, 50)], "two": [path(0, 4, 50)], "on": [path(50, 0, 9)]},
    }
    texts = {name: json.dumps(rows, separators=(",", ":")) for name, rows in {**tables, "map": city}.items()}
    write("nuscenes", "two-tracks", sections(texts))
    # Curvatures that are infinite.
    write("nuscenes", "no-place", sections({**texts, "map": texts["map"].replace('"radius":9', '"radius":1e-310')}))
    write("nuscenes", "no-map", sections({name: text for name, text in texts.items() if name != "map"}))


def write_argoverse():
    rows = ["TIMESTAMP,TRACK_ID,OBJECT_TYPE,X,Y,CITY_NAME"]
    for step in range(12):
        time = 315_970_000 + 0.1 * step
        rows += [f"{time:.1f},av,AV,{step},0,PIT", f"{time:.1f},agent,AGENT,{10 + 0.8 * step:.1f},3.5,PIT"]
        if step % 4 == 0:
            rows.append(f"{time:.1f},parked,OTHERS,30,7,PIT")
    nodes = "".join(f'<node id="{i}" x="{x}" y="{y}"/>\n'
                    for i, (x, y) in enumerate([(0, 0), (50, 0), (100, 0), (0, 3.5), (50, 3.5)]))

    def way(lane, refs, **tags):
        inside = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        return f'<way lane_id="{lane}">{inside}' + "".join(f'<nd ref="{ref}"/>' for ref in refs) + "</way>\n"

    city = f"<ArgoverseVectorMap>\n{nodes}" + way(1, (0, 1), l_neighbor_id=3, successor=2) + \
        way(2, (1, 2), predecessor=1) + way(3, (3, 4), r_neighbor_id=1, l_neighbor_id="None") + "</ArgoverseVectorMap>\n"
    write("argoverse", "with-map", sections({"map": city, "sequence": "\n".join(rows)}))
    write("argoverse", "short", sections({"sequence": "\n".join(rows[:6])}))


def write_stream(pb, scene):
    scene.agents[0].type = 1  # a vehicle, which the model answers about

    def add(script, name, **timeout):
        request = script.steps.add().request
        request.request_id = name
        request.request.scenarios.add().CopyFrom(scene)
        for field, value in timeout.items():
            setattr(request.timeout, field, value)
        return request

    answered = pb.StreamScript()
    add(answered, "a").request.query.top_k = 2
    answered.steps.add(event=pb.STREAM_EVENT_TAKES)
    add(answered, "b", nanos=1).request.model = "models/town"
    answered.steps.add(raw=b"\x0a\x01b\x12\x03\xff\xff\xff")
    answered.steps.add(event=pb.STREAM_EVENT_ENDS)
    write("stream", "answered", answered.SerializeToString())
    held = pb.StreamScript()
    held.steps.add(event=pb.STREAM_EVENT_HOLDS)
    add(held, "a")
    add(held, "a").request.model = "models/none"
    add(held, "c", seconds=5).request.query.joint_combinations = 2
    for event in (pb.STREAM_EVENT_DRAINS, pb.STREAM_EVENT_RELEASES, pb.STREAM_EVENT_TAKES):
        held.steps.add(event=event)
    write("stream", "drained", held.SerializeToString())
    held.steps[4].event = pb.STREAM_EVENT_CANCELS
    write("stream", "cancelled", held.SerializeToString())


def main():
    predictions, scenarios, settings, waymo, index, tags, script = generated({
        SOURCE / "proto": sorted(str(p.relative_to(SOURCE / "proto")) for p in (SOURCE / "proto").rglob("*.proto")),
        SOURCE / "model" / "data": ["shard_index.proto"],
        SOURCE / "model" / "data" / "waymo": ["waymo_scenario.proto"],
        SOURCE / "model" / "tags": ["tag_files.proto"],
        HERE: ["stream_script.proto"]})
    for name, scene in scenes(scenarios).items():
        for harness in ("scenario", "lane_paths"):
            write(harness, name, scene.SerializeToString())
        message = predictions.StreamPredictRequest(request_id=f"request-{name}")
        message.timeout.nanos = 50_000_000
        message.request.model = "models/town"
        message.request.scenarios.add().CopyFrom(scene)
        message.request.query.top_k = 3
        message.request.query.representatives = 2
        message.request.query.joint_combinations = 3
        if name != "fork":  # small ones: the outline does not care what is in a scene
            write("outline", name, message.SerializeToString())
    message = predictions.StreamPredictRequest()
    message.request.query.action_ids.ids.extend([0, 6, 2])
    write("outline", "actions", message.SerializeToString())

    write("settings", "lanes", settings.TrainingSettings(preset="lanes").SerializeToString())
    paper = settings.TrainingSettings(preset="paper")
    paper.model.actions = 12
    paper.model.decoder.hidden.extend([40, 40])
    write("settings", "paper", paper.SerializeToString())

    write("tfrecord", "two-records", record(b"abc") + record(b"") + record(b"x" * 40))
    write("tfrecord", "longer", record(b"a" * 5) + struct.pack("<QI", 1 << 40, 0) + b"cut off")
    write("tfrecord", "damaged", record(b"abc")[:-1] + b"?" + record(b"after it") + b"cut")
    import gzip
    write("tfrecord", "packed", gzip.compress(record(b"abc") + record(b"defg" * 30), mtime=0))
    believed = index.ShardIndex(format_version=1)
    offset = 0
    for scenario_id in ("a", "b"):  # as the harness writes them
        scene = scenarios.Scenario(scenario_id=scenario_id)
        scene.agents.add(id=1, length=4, width=2).states.add()
        payload = scene.SerializeToString()
        believed.recordings.add(scenario_id=scenario_id, offset=offset, payload_bytes=len(payload),
                                payload_crc=masked(payload))
        offset += len(record(payload))
    write("shard_index", "believed", believed.SerializeToString())
    write("shard_index", "foreign", index.ShardIndex(format_version=1, shard_sha256="0" * 64).SerializeToString())
    write_waymo(waymo)
    write_nuscenes()
    write_argoverse()
    write_stream(script, scenes(scenarios)["walk"])
    head = tags.TagHead(rows=5, windows=5, csv_bytes=100, scenes=["a", "b", "c", "d"], action_rows=[2, 2, 1])
    for size in (4, 8, 4, 8, 8, 4, 4, 4, 4, 4, 8, 4, 4, 4, 4, 8, 8, 4, 4, 4, 4, 4):
        head.columns.add(bytes=size, least=0, most=1)
    for place in (6, 11):  # action and likeliest: some number of 0 to 2
        head.columns[place].most = 0
    write("tags", "five-rows", head.SerializeToString())

    header = b'{"a":{"dtype":"F32","shape":[2,1],"data_offsets":[0,8]},"b":{"dtype":"F32","shape":[],"data_offsets":[8,12]}}'
    header += b" " * (-len(header) % 8)
    write("safetensors", "two-tensors", struct.pack("<Q", len(header)) + header + struct.pack("<fff", 1, -2, 0.5))

    whole = bytes([0, 0]) + bytes([2, 255]) * 3 + bytes([6, 0])
    write("upload", "whole", whole)
    write("upload", "broken-off", bytes([0, 2, 2, 20, 8, 0, 0, 3, 2, 255, 2, 255, 6, 0]))
    write("upload", "two-callers", bytes([0, 0, 1, 0, 2, 9, 3, 30, 4, 7, 3, 255, 7, 0, 10, 0]))


if __name__ == "__main__":
    main()
