"""Each example, as its page says to run it, against a server with a small model."""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

import numpy
from google.protobuf import json_format

import maneuver
from server import PROGRAMS, Server, trained_server

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
EXAMPLES = REPOSITORY / "examples"
SCENE = EXAMPLES / "scene.json"
BUILD = pathlib.Path(os.environ["BUILD"])


def run(*command, cwd=None, succeeds=True, **environment):
    """Runs a program that has to succeed, or to fail; returns what it printed."""
    path = f"{PROGRAMS}:{os.environ['PATH']}"
    done = subprocess.run([*map(str, command)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, cwd=cwd, env={**os.environ, "PATH": path, **environment},
                          timeout=600)
    if (done.returncode == 0) != succeeds:
        raise AssertionError(f"{command}: {done.returncode}\n{done.stdout}")
    return done.stdout


def python(program, *arguments, **options):
    return run(sys.executable, EXAMPLES / program, *arguments, **options)


class ExamplesTest(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.address = trained_server().address
        cls.temporary = tempfile.TemporaryDirectory(prefix="maneuver-examples-")
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.prefix = cls.folder / "prefix"
        run("cmake", "--install", BUILD, "--component", "client", "--prefix", cls.prefix)

    def test_the_page_explains_the_scene_as_it_is(self):
        self.assertLessEqual(len(SCENE.read_text().splitlines()), 20)
        page = (EXAMPLES / "README.md").read_text()
        explained = re.search(r"```jsonc\n(.*?)```", page, re.DOTALL)[1]
        self.assertEqual(json.loads(re.sub(r" *//.*", "", explained)),
                         json.loads(SCENE.read_text()))

    def test_the_command_line_answers(self):
        answer = run("maneuver", "--server", self.address, "probability", SCENE)
        self.assertRegex(answer, r"by-hand +7 +\d+ +\S.* +\d+\.\d %")

    def expected(self):
        """What each of the three languages prints."""
        with maneuver.Client(self.address) as client:
            answer = client.predict(maneuver.load_scenario(SCENE), top_k=3).target()
        lines = ["vehicle 7, by models/tiny/versions/1"]
        for action, probability, path in zip(answer.action_ids, answer.action_probabilities,
                                             answer.mean_trajectories):
            lines.append(f"action {action}  probability {probability:.3f}  after 4.0 s at "
                         f"({path[-1][0]:.1f}, {path[-1][1]:.1f})")
        return lines

    def test_python(self):
        self.assertEqual(python("python/predict.py", SCENE, self.address).splitlines(),
                         self.expected())
        wrong = self.folder / "wrong.json"
        wrong.write_text(SCENE.read_text().replace('"length": 4.5', '"length": -4.5'))
        self.assertIn("scenarios[0].agents[0].length",
                      python("python/predict.py", wrong, self.address, succeeds=False))

    def test_cpp(self):
        build = self.folder / "cpp"
        run("cmake", "-S", EXAMPLES / "cpp", "-B", build, "-G", "Ninja",
            f"-DCMAKE_PREFIX_PATH={self.prefix}")
        run("cmake", "--build", build)
        self.assertEqual(run(build / "predict", SCENE, self.address).splitlines(), self.expected())
        run(build / "predict", EXAMPLES / "README.md", self.address, succeeds=False)

    def test_the_code_on_the_page_about_python_runs(self):
        page = next((REPOSITORY / "docs").rglob("python.md")).read_text()
        code = "\n".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL))
        program = self.folder / "page.py"
        program.write_text(code.replace("127.0.0.1:8470", self.address)
                           .replace("models/town", "models/tiny"))
        printed = run(sys.executable, program, cwd=EXAMPLES)
        self.assertIn("scenarios[0].agents[0].width", printed)
        self.assertIn("(12, 10, 2, 2)", printed)

    def test_programs_in_python_have_types_that_fit(self):
        for program in sorted(EXAMPLES.rglob("*.py")):
            run(sys.executable, "-m", "mypy", "--config-file",
                REPOSITORY / "client/python/pyproject.toml", "--cache-dir", self.folder / "mypy",
                program, MYPYPATH=os.environ["PYTHONPATH"].split(":")[0])

    def test_javascript(self):
        folder = self.folder / "javascript"
        shutil.copytree(EXAMPLES / "javascript", folder,
                        ignore=shutil.ignore_patterns("node_modules"))
        if shutil.which("npm") is None:
            self.skipTest("npm is not installed")
        installed = subprocess.run(["npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts"],
                                   cwd=folder, capture_output=True, text=True, timeout=120)
        if installed.returncode != 0:
            self.skipTest(f"npm ci: {installed.stderr[-500:]}")
        printed = run("node", "predict.mjs", SCENE, self.address, cwd=folder,
                      MANEUVER_PROTO=str(self.prefix / "share/maneuver/proto"))
        self.assertEqual(printed.splitlines(), self.expected())
        extracted = self.folder / "extracted.json"  # lowerCamelCase, as scenario extract writes it
        extracted.write_text(json_format.MessageToJson(maneuver.load_scenario(SCENE)))
        self.assertEqual(run("node", "predict.mjs", extracted, self.address, cwd=folder,
                             MANEUVER_PROTO=str(self.prefix / "share/maneuver/proto")), printed)

    def test_planner_answers_every_cycle(self):
        printed = python("planner/planner.py", self.address, "--cycles", 20, "--deadline", 5)
        self.assertIn("20 cycles, 20 answered in time, 0 not", printed)

    def test_planner_goes_on_without_answers(self):
        printed = python("planner/planner.py", self.address, "--cycles", 8, "--deadline", 1e-9)
        self.assertIn("8 cycles, 0 answered in time, 8 not", printed)
        self.assertIn("assuming constant velocity", printed)

    def commonroad(self, *options):
        """Predicts the scenario that was made up; returns the root of what was written."""
        output = self.folder / "predicted.xml"
        printed = python("commonroad/predict.py", EXAMPLES / "commonroad/two_lanes.xml", output,
                         self.address, *options)
        self.assertIn("3 obstacles predicted by models/tiny/versions/1", printed)
        return ElementTree.parse(output).getroot()

    def test_commonroad_writes_trajectories(self):
        root = self.commonroad()
        # The tags that the format knows, in its order.
        self.assertEqual(
            [element.tag for element in root],
            ["location", "scenarioTags", "lanelet", "lanelet", "staticObstacle", "dynamicObstacle",
             "dynamicObstacle", "dynamicObstacle", "planningProblem"])
        obstacle = root.find("dynamicObstacle[@id='20']")
        self.assertEqual([element.tag for element in obstacle],
                         ["type", "shape", "initialState", "trajectory"])
        self.assertEqual(obstacle.findtext("initialState/position/point/x"), "31")
        states = obstacle.findall("trajectory/state")
        self.assertEqual([int(state.findtext("time/exact")) for state in states],
                         list(range(11, 51)))
        # At the waypoints, four steps apart, it is where the most probable action has its mean.
        with maneuver.Client(self.address) as client:
            expected = client.predict(self.commonroad_scene(), top_k=1).target()
        way = [[float(state.findtext(f"position/point/{axis}")) for axis in "xy"]
               for state in states[3::4]]
        numpy.testing.assert_allclose(way, expected.mean_trajectories[0], atol=2e-3)
        # Between the waypoints it moves evenly.
        speeds = [float(state.findtext("velocity/exact")) for state in states[7::4]]
        steps = numpy.hypot(*numpy.diff(way, axis=0).T)
        numpy.testing.assert_allclose(speeds, steps / 0.4, atol=1e-2)

    def commonroad_scene(self):
        """The made-up scenario, by `maneuver`, with obstacle 20 as its target."""
        dataset, scene = self.folder / "commonroad", self.folder / "commonroad.json"
        run("maneuver", "import", "commonroad", dataset, EXAMPLES / "commonroad/two_lanes.xml")
        run("maneuver", "scenario", "extract", dataset, "ZAM_TwoLanes-1_1_T-1", "--target", 20,
            "--out", scene)
        return maneuver.load_scenario(scene)

    def test_commonroad_writes_occupancies(self):
        root = self.commonroad("--occupancies")
        occupancies = root.findall("dynamicObstacle[@id='10']/occupancySet/occupancy")
        self.assertEqual(len(occupancies), 40)
        for occupancy in occupancies:
            self.assertEqual([element.tag for element in occupancy], ["shape", "time"])
            rectangles = occupancy.findall("shape/rectangle")
            self.assertGreater(len(rectangles), 1)
            self.assertEqual([element.tag for element in rectangles[0]],
                             ["length", "width", "orientation", "center"])

    def test_what_commonroad_writes_can_be_read_again(self):
        self.commonroad()
        again = self.folder / "again"
        run("maneuver", "import", "commonroad", again, self.folder / "predicted.xml", "--strict")
        listed = run("maneuver", "scenario", "list", again, "--output", "json")
        self.assertIn("ZAM_TwoLanes-1_1_T-1", listed)

    def test_the_walkthrough_goes_from_nothing_to_answers(self):
        server = Server()
        self.addCleanup(server.close)
        printed = python("python/walkthrough.py", server.address, self.folder / "walkthrough")
        self.assertIn("made models/walkthrough/versions/1", printed)
        self.assertIn("(12, 10, 2)", printed)
        self.assertIn("scenarios[0].agents[0].length: ", printed)


if __name__ == "__main__":
    unittest.main()
