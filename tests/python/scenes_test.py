"""Scenes from dicts, dataclasses and arrays. No server."""

import json
import math
import pathlib
import tempfile
import unittest

import numpy

import maneuver
from maneuver import v1
from maneuver.scenes import to_proto, to_protos

AS_DICT = {
    "scenario_id": "two", "prediction_time": 1.0, "target_ids": ["7"],
    "agents": [
        {"id": 7, "type": "AGENT_TYPE_VEHICLE", "length": 4.5, "width": 1.9, "states": [
            {"time": 0.0, "x": 1.0, "y": 2.0, "heading": 0.5, "velocity_x": 8.0, "velocity_y": 4.0},
            {"time": 1.0, "x": 9.0, "y": 6.0, "heading": 0.5, "velocity_x": 8.0, "velocity_y": 4.0},
        ]},
        {"id": 8, "type": "AGENT_TYPE_PEDESTRIAN", "length": 0.5, "width": 0.75, "states": [
            {"time": 1.0, "x": 3.0, "y": 3.0, "heading": 0.0, "velocity_x": 1.0, "velocity_y": 0.0},
        ]}],
    "map_features": [{"id": 3, "type": "MAP_FEATURE_TYPE_LANE_CENTERLINE", "x": [0.0, 10.0],
                      "y": [2.0, 2.5], "speed_limit": 13.5, "successor_ids": [4]}],
    "traffic_signals": [{"lane_id": 3, "readings": [
        {"time": 0.0, "state": "TRAFFIC_SIGNAL_STATE_STOP"},
        {"time": 1.0, "state": "TRAFFIC_SIGNAL_STATE_GO"}]}]}

LANE = maneuver.MapFeature("lane_centerline", [(0.0, 2.0), (10.0, 2.5)], id=3, speed_limit=13.5,
                           successor_ids=[4])
SIGNAL = maneuver.TrafficSignal(3, [(0.0, "stop"), (1.0, "go")])
NAN = math.nan
# The pedestrian is not seen at the first time.
TRACKS = numpy.array([[[1.0, 2.0, 0.5, 8.0, 4.0], [9.0, 6.0, 0.5, 8.0, 4.0]],
                      [[NAN, NAN, NAN, NAN, NAN], [3.0, 3.0, 0.0, 1.0, 0.0]]])


def dataclass_scene(**changes):
    values = dict(
        scenario_id="two", prediction_time=1.0, target_ids=[7],
        agents=[maneuver.Agent(7, length=4.5, width=1.9, states=[
                    (0.0, 1.0, 2.0, 0.5, 8.0, 4.0), (1.0, 9.0, 6.0, 0.5, 8.0, 4.0)]),
                maneuver.Agent(8, numpy.array([[1.0, 3.0, 3.0, 0.0, 1.0, 0.0]]), 0.5, 0.75,
                               "pedestrian")],
        map_features=[LANE], traffic_signals=[SIGNAL])
    return maneuver.Scenario(**{**values, **changes})


class ScenesTest(unittest.TestCase):

    def test_a_dict_a_dataclass_and_arrays_make_the_same_message(self):
        from_arrays = maneuver.Scenario.from_arrays(
            times=[0.0, 1.0], tracks=TRACKS, sizes=[[4.5, 1.9], [0.5, 0.75]], ids=[7, 8],
            target_ids=[7], types=["vehicle", "pedestrian"], map_features=[LANE],
            traffic_signals=[SIGNAL], scenario_id="two")
        expected = to_proto(AS_DICT)
        self.assertEqual(expected.agents[0].states[1].velocity_y, 4.0)
        self.assertEqual(to_proto(dataclass_scene()), expected)
        self.assertEqual(to_proto(from_arrays), expected)

    def test_from_proto_keeps_everything(self):
        message = to_proto(AS_DICT)
        message.map_id = "ab"
        message.map_features[0].left_neighbor_ids.append(5)
        message.map_features[0].right_neighbor_ids.append(6)
        self.assertEqual(maneuver.Scenario.from_proto(message).to_proto(), message)

    def test_takes_map_features_as_messages_too(self):
        ready = maneuver.scenes.map_to_proto([LANE])
        self.assertEqual(dataclass_scene(map_features=ready).to_proto(), to_proto(AS_DICT))

    def test_takes_one_scene_or_several(self):
        self.assertEqual(len(to_protos(AS_DICT)), 1)
        self.assertEqual(len(to_protos([AS_DICT, dataclass_scene(), v1.Scenario()])), 3)

    def test_refuses_states_of_another_width_with_their_path(self):
        agent = maneuver.Agent(7, numpy.zeros((3, 5)), 4.5, 1.9)
        with self.assertRaisesRegex(ValueError, r"agents\[1\]\.states: .* 6 numbers .* not of 5"):
            dataclass_scene(agents=[maneuver.Agent(8, [], 1.0, 1.0), agent]).to_proto()
        for wrong in ([1.0, 2.0], numpy.zeros((2, 2, 2)), [(1.0, 2.0), (1.0,)]):
            with self.assertRaisesRegex(ValueError, r"map_features\[0\]\.points: .* 2 numbers"):
                dataclass_scene(map_features=[maneuver.MapFeature("road_edge", wrong)]).to_proto()

    def test_refuses_what_is_no_table_with_its_path(self):
        for wrong in (None, 3.0):
            with self.assertRaisesRegex(ValueError, r"agents\[0\]\.states: expected rows of 6 numbers"):
                dataclass_scene(agents=[maneuver.Agent(7, wrong, 4.5, 1.9)]).to_proto()

    def test_refuses_what_is_no_number_with_its_path(self):
        lane = maneuver.MapFeature("road_edge", [("a", 1.0)])
        with self.assertRaisesRegex(ValueError, r"map_features\[0\]\.points: "):
            dataclass_scene(map_features=[lane]).to_proto()

    def test_refuses_a_type_that_is_not_known_and_names_those_that_are(self):
        lane = maneuver.MapFeature("lane", [(0.0, 1.0)])
        with self.assertRaisesRegex(ValueError, "map_features.0..type: 'lane' .*lane_centerline"):
            dataclass_scene(map_features=[lane]).to_proto()

    def test_refuses_arrays_of_other_lengths(self):
        with self.assertRaisesRegex(ValueError, "2, 1, 2 and 1 agents"):
            maneuver.Scenario.from_arrays(times=[0.0, 1.0], tracks=TRACKS, ids=[7],
                                          sizes=[[4.5, 1.9], [0.5, 0.75]], target_ids=[7])
        with self.assertRaisesRegex(ValueError, r"tracks\[0\] has 2 rows for 1 times"):
            maneuver.Scenario.from_arrays(times=[0.0], tracks=TRACKS, ids=[7, 8],
                                          sizes=[[4.5, 1.9], [0.5, 0.75]], target_ids=[7])

    def test_refuses_a_dict_with_a_field_that_does_not_exist(self):
        with self.assertRaisesRegex(ValueError, "agent_list"):
            to_proto({"agent_list": []})

    def test_refuses_what_is_no_scene(self):
        with self.assertRaisesRegex(ValueError, "no str"):
            to_proto("scene.json")

    def test_loads_a_file_and_names_one_that_is_wrong(self):
        with tempfile.TemporaryDirectory() as folder:
            good, bad = pathlib.Path(folder, "good.json"), pathlib.Path(folder, "bad.json")
            good.write_text(json.dumps(AS_DICT))
            bad.write_text("{")
            self.assertEqual(maneuver.load_scenario(good), to_proto(AS_DICT))
            good.write_text(json.dumps(AS_DICT), encoding="utf-8-sig")  # as some editors begin it
            self.assertEqual(maneuver.load_scenario(good), to_proto(AS_DICT))
            with self.assertRaisesRegex(ValueError, "bad.json: "):
                maneuver.load_scenario(str(bad))


if __name__ == "__main__":
    unittest.main()
