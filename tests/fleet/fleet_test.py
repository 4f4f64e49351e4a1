#!/usr/bin/python3
"""maneuver tag and maneuver find as they are shipped, on a small town.

    tests/fleet/fleet_test.py --maneuver build/release/bin/maneuver \
        --small-model build/release/tests/write_small_model [unittest options]

What find answers is compared with this file's own reading of the CSV files, and with DuckDB's where the module of
tests/fleet/package.json is there.
"""

import argparse
import collections
import csv
import fnmatch
import gzip
import json
import math
import os
import pathlib
import random
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
GUIDE = HERE.parent.parent / "docs/guides/tagging.md"
DATASETS = 8
INTEGERS = {"target", "windows", "action", "likeliest"}
TEXTS = {"dataset", "scene", "class", "name", "responsibilities"}
options = argparse.Namespace(maneuver=None, small_model=None)
folder = None  # of all tests; has the model `small`, the datasets d0 .. d7, `tags` and `windows`


def run(*arguments, status=0):
    done = subprocess.run([options.maneuver, "--progress", "none", *map(str, arguments)], cwd=folder,
                          capture_output=True, text=True)
    assert done.returncode == status, f"{arguments}: {done.returncode}\n{done.stderr}"
    return done


def find(*arguments):
    return json.loads(run("--output", "json", "find", *arguments).stdout)


def datasets():
    return [f"d{i}" for i in range(DATASETS)]


def each_dataset():
    return [word for name in datasets() for word in ("--dataset", name)]


def contents(tags):
    """Every file of a folder, hidden ones too."""
    return {path.name: path.read_bytes() for path in (folder / tags).iterdir()}


def number(name, text):
    return text if name in TEXTS else int(text) if name in INTEGERS else float(text)


def rows(tags):
    """All rows of a folder, by file, in order."""
    found = []
    for file in sorted((folder / tags).glob("*.csv.gz")):
        with gzip.open(file, "rt", newline="") as lines:
            found += [{name: number(name, text) for name, text in row.items()} for row in csv.DictReader(lines)]
    return found


def key(row):
    return row["dataset"], row["scene"], int(row["target"]), row["from_time"], row["action"]


def keys(matches):
    return [key(row) for row in matches]


class TagTest(unittest.TestCase):
    def test_a_second_run_changes_nothing(self):
        before = contents("tags")
        times = {path: path.stat().st_mtime_ns for path in (folder / "tags").iterdir()}
        self.assertIn(f"{DATASETS} were there", run("tag", *datasets(), "--model", "small", "-o", "tags").stdout)
        self.assertEqual(contents("tags"), before)
        self.assertEqual({path: path.stat().st_mtime_ns for path in (folder / "tags").iterdir()}, times)

    def test_parts_together_write_the_same_bytes(self):
        for part in range(3):
            run("tag", *datasets(), "--model", "small", "-o", "parts", "--shards", f"{part}/3", "--threads", 1 + part)
        self.assertEqual(contents("parts"), contents("tags"))

    def test_a_killed_run_is_continued_without_loss_or_repetition(self):
        command = [options.maneuver, "--progress", "json", "tag", *datasets(), "--model", "small", "-o", "killed"]
        with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL,
                              text=True) as process:
            for line in process.stderr:
                shards = re.search(r"([0-9]+) shards", line)
                if shards and int(shards[1]) >= 2:
                    break
            process.send_signal(signal.SIGKILL)
        self.assertEqual(process.returncode, -signal.SIGKILL, "it ended before it could be killed")
        left = contents("killed")
        complete = {name for name in left if name.endswith(".tags")}
        self.assertGreaterEqual(len(complete), 2)
        self.assertLess(len(complete), DATASETS)
        whole = contents("tags")
        for name, content in left.items():
            if not name.startswith("."):
                self.assertEqual(content, whole[name], name)
        self.assertEqual(find("killed")["missingShards"], DATASETS - len(complete))
        run("tag", *datasets(), "--model", "small", "-o", "killed")
        self.assertEqual(contents("killed"), whole)

    def test_a_damaged_shard_is_named_and_the_others_are_tagged(self):
        shutil.copytree(folder / "d0", folder / "broken/d0")
        shard = folder / "broken/d0/scenarios-00000.tfrecord"
        content = bytearray(shard.read_bytes())
        content[len(content) // 2] ^= 1
        shard.write_bytes(content)
        done = run("tag", "broken/d0", "d1", "--model", "small", "-o", "partly", status=1)
        self.assertIn("scenarios-00000.tfrecord", done.stderr)
        self.assertEqual({name for name in contents("partly") if name.endswith(".tags")},
                         {"d1-scenarios-00000.tags"})

    def test_tags_of_another_model_are_not_mixed(self):
        subprocess.run([options.small_model, folder / "second", "2"], check=True)
        before = contents("tags")
        self.assertIn("model_sha256", run("tag", *datasets(), "--model", "second", "-o", "tags", status=1).stderr)
        self.assertEqual(contents("tags"), before)

    def test_wrong_parts_are_refused(self):
        for wrong in ("3/3", "1", "-1/2", "0/0", "a/b"):
            self.assertIn("--shards", run("tag", "d0", "--model", "small", "-o", "no", "--shards", wrong,
                                          status=2).stderr)
        self.assertFalse((folder / "no").exists())

    def test_rows_are_sorted_and_their_windows_are_those_of_single_windows(self):
        merged, windows = rows("tags"), rows("windows")
        order = [(row["dataset"], row["scene"], row["target"], row["from_time"]) for row in merged]
        self.assertEqual(order, sorted(order))
        self.assertEqual(sum(row["windows"] for row in merged), len(windows))
        left = iter(windows)
        for row in merged:
            steps = row["windows"]
            parts = [next(left) for _ in range(steps)]  # both are sorted
            self.assertEqual({part["target"] for part in parts}, {row["target"]})
            self.assertEqual((parts[0]["from_time"], parts[-1]["to_time"]), (row["from_time"], row["to_time"]))
            # A state may be missing, and the nearest one counts.
            self.assertTrue(all(0 < b["from_time"] - a["from_time"] < 0.75 for a, b in zip(parts, parts[1:])))
            self.assertEqual({part["action"] for part in parts}, {row["action"]})
            self.assertAlmostEqual(sum(part["probability"] for part in parts) / steps, row["probability"], delta=2e-6)
            self.assertAlmostEqual(sum(part["ade"] for part in parts) / steps, row["ade"], delta=0.011)
            self.assertEqual(max(part["surprise"] for part in parts), row["surprise"])
            for part in parts:
                self.assertAlmostEqual(part["surprise"], -math.log(part["probability"]), delta=1e-3)
            for name in ("speed", "x", "y", "heading"):
                self.assertEqual(parts[0][name], row[name])
        for before, after in zip(merged, merged[1:]):
            if (before["scene"], before["target"], before["action"]) == (after["scene"], after["target"],
                                                                         after["action"]):
                self.assertGreater(after["from_time"] - before["to_time"], 0.75)


class FindTest(unittest.TestCase):
    def check(self, expected, *arguments, tags="tags"):
        self.assertTrue(expected, "the test would check nothing")
        answer = find(tags, "--limit", 1000000, *arguments)
        self.assertEqual(keys(answer["matches"]), keys(expected))
        self.assertEqual(answer["rows"], len(expected))
        self.assertEqual(answer["windows"], sum(row["windows"] for row in expected))
        return answer

    def test_conditions(self):
        everything = rows("tags")
        self.check([row for row in everything if fnmatch.fnmatch(row["name"], "*[12]") and row["probability"] >= .1
                    and 1 <= row["speed"] <= 12 and row["ade"] > .5 and row["scene"].endswith(("-1", "-2"))],
                   "--action", "*[12]", "--min-probability", .1, "--speed", "1..12", "--where", "ade > 0.5",
                   "--scene", "*-1", "--scene", "*-2")
        self.check([row for row in everything if row["windows"] != 1], "--where", "windows!=1")
        # Both ends of a range count, as the decimal number that the CSV has.
        edge = everything[len(everything) // 2]["speed"]
        self.check([row for row in everything if row["speed"] == edge], "--speed", f"{edge}..{edge}")

    def test_near(self):
        everything = rows("tags")
        middle = everything[7]
        self.check([row for row in everything
                    if (row["x"] - middle["x"]) ** 2 + (row["y"] - middle["y"]) ** 2 <= 60 ** 2],
                   "--near", f"{middle['x']},{middle['y']},60")

    def test_followed_by(self):
        everything = rows("tags")
        tracks = collections.defaultdict(list)
        for row in everything:
            tracks[row["dataset"], row["scene"], row["target"]].append(row)
        expected = [row for row in everything if row["action"] == 1 and any(
            later["from_time"] > row["from_time"] and later["from_time"] - row["to_time"] <= 1 + 1e-9
            and later["action"] in (0, 2) for later in tracks[row["dataset"], row["scene"], row["target"]])]
        answer = self.check(expected, "--action", "1", "--followed-by", "0", "--followed-by", "2", "--within", 1)
        for match in answer["matches"]:
            self.assertEqual(match["followedBy"]["target"], match["target"])
            self.assertIn(match["followedBy"]["action"], (0, 2))

    def test_two_targets_in_one_scene(self):
        everything = rows("windows")
        scenes = collections.defaultdict(list)
        for row in everything:
            scenes[row["dataset"], row["scene"]].append(row)

        def place(row, time):
            driven = row["speed"] * (time - row["from_time"])
            return row["x"] + driven * math.cos(row["heading"]), row["y"] + driven * math.sin(row["heading"])

        def meets(row, other, then):
            if other["target"] == row["target"] or other["action"] != 0:
                return False
            after = other["from_time"] - row["from_time"]
            if not (0 < after <= 1 + 1e-9 if then else after == 0):
                return False
            (x, y), (other_x, other_y) = place(row, other["from_time"]), place(other, other["from_time"])
            ahead = (other_x - x) * math.cos(row["heading"]) + (other_y - y) * math.sin(row["heading"])
            return math.hypot(other_x - x, other_y - y) <= 30 and ahead < 0

        for option, then in (("--with", False), ("--answered-by", True)):
            expected = [row for row in everything if row["action"] == 2 and any(
                meets(row, other, then) for other in scenes[row["dataset"], row["scene"]])]
            within = ("--within", 1) if then else ()
            self.check(expected, "--action", 2, option, 0, *within, "--distance", 30, "--side", "behind",
                       tags="windows")

    def test_the_most_surprising_come_first(self):
        everything = sorted(rows("tags"), key=lambda row: -row["surprise"])
        answer = find("tags", "--surprise", "top:25")
        self.assertEqual([row["surprise"] for row in answer["matches"]],
                         [row["surprise"] for row in everything[:25]])
        self.assertEqual(answer["rows"], len(everything))

    def test_groups(self):
        for by, name in (("action", lambda row: row["name"]), ("class", lambda row: row["class"]),
                         ("scene", lambda row: row["scene"]), ("dataset", lambda row: row["dataset"]),
                         ("speed", lambda row: "{0}..{1}".format(*(5 * int(row["speed"] // 5 + i) for i in (0, 1)))),
                         ("place", lambda row: "{:g},{:g}".format(*(100 * (row[c] // 100) + 50 for c in "xy")))):
            expected = collections.defaultdict(lambda: [0, 0, 0.0])
            for row in rows("tags"):
                sums = expected[name(row)]
                sums[0] += 1
                sums[1] += row["windows"]
                sums[2] += row["windows"] * row["probability"]
            groups = find("tags", "--by", by)["groups"]
            self.assertEqual({group: (sums["rows"], sums["windows"], round(sums["probability"], 6))
                              for group, sums in groups.items()},
                             {group: (n, windows, round(p / windows, 6)) for group, (n, windows, p) in expected.items()})

    def test_shares_of_two_folders_are_compared_with_the_error_of_drawing_recordings(self):
        run("tag", "d0", "d1", "d2", "d3", "--model", "small", "-o", "june")
        run("tag", "d4", "d5", "d6", "d7", "--model", "small", "-o", "may")
        changes = find("june", "--by", "action", "--against", "may")["changes"]
        scenes = {tags: collections.defaultdict(collections.Counter) for tags in ("june", "may")}
        for tags, counts in scenes.items():
            for row in rows(tags):
                counts[row["dataset"], row["scene"]][row["name"]] += row["windows"]

        def share(drawn, name):
            return sum(scene[name] for scene in drawn) / sum(scene.total() for scene in drawn)

        random.seed(1)
        boots = [[random.choices(list(counts.values()), k=len(counts)) for counts in scenes.values()]
                 for _ in range(2000)]
        self.assertTrue(changes)
        for name, change in changes.items():
            june, may = (share(counts.values(), name) for counts in scenes.values())
            self.assertAlmostEqual(change["difference"], june - may, places=9)
            differences = [share(a, name) - share(b, name) for a, b in boots]
            reach = 1.96 * statistics.pstdev(differences) * math.sqrt(12 / 11)
            self.assertAlmostEqual((change["high"] - change["low"]) / 2 / reach, 1.0, delta=0.12)
            self.assertAlmostEqual((change["high"] + change["low"]) / 2, june - may, places=9)

    def test_each_part_has_the_statistics_of_its_rows_alone(self):
        parts = find("tags", "--by", "action", "--per", "dataset", "--against", "tags")["parts"]
        self.assertEqual(set(parts), set(datasets()))
        for name, part in parts.items():
            counts = collections.Counter()
            for row in rows("tags"):
                if row["dataset"] == name:
                    counts[row["name"]] += row["windows"]
            self.assertEqual({group: sums["windows"] for group, sums in part["groups"].items()}, dict(counts))
            self.assertEqual(part["windows"], counts.total())
            for group, sums in part["groups"].items():
                self.assertAlmostEqual(sums["share"], counts[group] / counts.total(), places=9)
            self.assertTrue(part["changes"])
            for change in part["changes"].values():
                self.assertEqual(change["difference"], 0.0)
                self.assertLessEqual(change["low"], 0.0)
        self.assertEqual(find("tags", "--by", "action", "--per", "dataset")["groups"],
                         find("tags", "--by", "action")["groups"])

    def test_shares_are_drawn_without_recordings(self):
        sizes = []
        for number, more in enumerate(((), ("--against", "tags"), ("--per", "speed"))):
            run("find", "tags", "--by", "action", *more, "--plot", f"shares-{number}.png")
            content = (folder / f"shares-{number}.png").read_bytes()
            self.assertTrue(content.startswith(b"\x89PNG"))
            sizes.append(content[16:24])
        self.assertEqual(sizes[0], sizes[1])
        self.assertGreater(sizes[2], sizes[0], "a panel for each speed")

    def test_a_dataset_of_the_surprising_has_no_near_duplicates(self):
        run("find", "tags", "--surprise", "top:12", "--as-dataset", "mined", *each_dataset())
        described = json.loads(run("--output", "json", "dataset", "show", "./mined").stdout)
        answer = find("tags", "--surprise", "top:12", "--distinct")["matches"]
        self.assertEqual(described["dataset"]["recordings"], str(len({row["scene"] for row in answer})))
        self.assertEqual(answer[0]["surprise"], max(row["surprise"] for row in rows("tags")))
        for i, row in enumerate(answer):
            for other in answer[:i]:
                turn = math.remainder(row["heading"] - other["heading"], 2 * math.pi)
                alike = (row["action"], row["likeliest"], row["class"]) == (
                    other["action"], other["likeliest"], other["class"])
                close = math.hypot(row["x"] - other["x"], row["y"] - other["y"]) <= 10
                near = all(math.hypot(row[f"{at}_x"] - other[f"{at}_x"], row[f"{at}_y"] - other[f"{at}_y"]) <= most
                           for at, most in (("mid", 2.5), ("end", 5.0)))
                self.assertFalse(alike and close and near and abs(turn) <= math.radians(30)
                                 and abs(row["speed"] - other["speed"]) <= 2)
                self.assertNotEqual((row["scene"], row["target"]), (other["scene"], other["target"]))

    def test_scenes_are_extracted_and_drawn(self):
        answer = find("tags", "--surprise", "top:3")["matches"]
        run("find", "tags", "--surprise", "top:3", *each_dataset(), "--extract", "scenes",
            "--plot", "found.png")
        scenes = [json.loads(path.read_text()) for path in sorted((folder / "scenes").iterdir())]
        self.assertEqual([(scene["scenarioId"], scene["targetIds"], scene["predictionTime"]) for scene in scenes],
                         [(row["scene"], [row["target"]], row["peak_time"]) for row in answer])
        self.assertTrue((folder / "found.png").read_bytes().startswith(b"\x89PNG"))

    def test_what_makes_no_sense_is_refused(self):
        for arguments, says in ((("--action", "fly*"), "no action is called"), (("--speed", "5"), "--speed"),
                                (("--near", "1,2"), "--near"), (("--where", "price>3"), "not a column"),
                                (("--where", "ade>x"), "not a number"), (("--surprise", "top:0"), "--surprise"),
                                (("--surprise", "nan"), "--surprise"), (("--surprise", "top:1000001"), "--surprise"),
                                (("--extract", "e"), "--dataset"), (("--against", "tags"), "--by"),
                                (("--per", "hour"), "--by"), (("--side", "ahead"), "--with"),
                                (("--within", "2"), "--followed-by"),
                                (("--with", "*", "--within", "2"), "--followed-by"),
                                (("--surprise", "top:3", "--limit", "5"), "give one of them"),
                                (("--by", "action", "--distinct"), "give it no --distinct"),
                                (("--by", "action", "--surprise", "top:3"), "give it no --distinct")):
            self.assertIn(says, run("find", "tags", *arguments, status=2).stderr)
        self.assertIn("schema.json", run("find", "d0", status=1).stderr)
        self.assertIn("another dataset", run("find", "tags", "--dataset", "elsewhere/d0", "--scene", "*-0",
                                             "--extract", "e", status=1).stderr)


class DuckDbTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.ask("SELECT 1 AS one")

    @staticmethod
    def ask(statement):
        done = subprocess.run(["node", HERE / "duckdb.cjs", statement], cwd=folder, capture_output=True, text=True)
        if done.returncode == 77:
            raise unittest.SkipTest(done.stdout.strip())
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    def test_counts_are_those_of_find(self):
        groups = find("tags", "--by", "action")["groups"]
        answer = self.ask("SELECT name, count(*) AS n, sum(windows) AS windows FROM 'tags/*.csv.gz' GROUP BY name")
        self.assertEqual({row["name"]: (int(row["n"]), int(row["windows"])) for row in answer},
                         {name: (group["rows"], group["windows"]) for name, group in groups.items()})
        some = find("tags", "--min-probability", .5, "--speed", "1..8", "--limit", 0)
        answer = self.ask("SELECT count(*) AS n FROM 'tags/*.csv.gz' "
                          "WHERE probability >= 0.5 AND speed BETWEEN 1 AND 8")
        self.assertEqual(int(answer[0]["n"]), some["rows"])

    def test_the_recipes_of_the_guide_work(self):
        recipes = re.findall(r"^```sql duckdb\n(.*?)^```$", GUIDE.read_text(), re.MULTILINE | re.DOTALL)
        self.assertGreaterEqual(len(recipes), 2)
        for recipe in recipes:
            for statement in filter(str.strip, recipe.split(";")):
                self.ask(statement)
        converted = self.ask("SELECT count(*) AS n, sum(windows) AS windows FROM 'tags.parquet'")
        self.assertEqual(int(converted[0]["n"]), find("tags", "--limit", 0)["rows"])


class PostgresTest(unittest.TestCase):
    """With a server of its own on a socket of its own, where PostgreSQL is installed."""

    @classmethod
    def setUpClass(cls):
        programs = sorted(pathlib.Path("/usr/lib/postgresql").glob("*/bin/initdb"))
        if not programs or not shutil.which("psql"):
            raise unittest.SkipTest("PostgreSQL is not installed")
        cls.programs = programs[-1].parent
        cls.user = []  # PostgreSQL refuses to run as root
        cls.place = pathlib.Path(tempfile.mkdtemp(prefix="maneuver-postgres-"))
        cls.addClassCleanup(shutil.rmtree, cls.place)
        if os.geteuid() == 0:
            cls.user = ["runuser", "-u", "postgres", "--"]
            shutil.chown(cls.place, "postgres")
        cls.pg("initdb", "-D", cls.place / "data", "--no-sync", "-A", "trust", "-U", "postgres")
        cls.pg("pg_ctl", "-D", cls.place / "data", "-w", "-t", "60", "-l", cls.place / "log", "-o",
               f"-c listen_addresses='' -c fsync=off -k {cls.place}", "start")
        cls.addClassCleanup(cls.pg, "pg_ctl", "-D", cls.place / "data", "-m", "immediate", "stop")

    @classmethod
    def pg(cls, program, *arguments):
        subprocess.run([*cls.user, cls.programs / program, *arguments], cwd="/", check=True,
                       stdout=subprocess.DEVNULL)

    def test_the_recipe_of_the_guide_works(self):
        guide = GUIDE.read_text()
        table = re.search(r"^```sql postgresql\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)[1]
        load = re.search(r"^for file in tags/.*$", guide, re.MULTILINE)[0]
        environment = dict(os.environ, PGHOST=str(self.place), PGUSER="postgres", PGDATABASE="postgres")

        def shell(command, text=""):
            return subprocess.run(["bash", "-euo", "pipefail", "-c", command], cwd=folder, env=environment, check=True,
                                  input=text, capture_output=True, text=True).stdout

        shell("psql -v ON_ERROR_STOP=1", table)
        shell(load)
        counts = shell("psql -At", "SELECT name, count(*), sum(windows) FROM tags GROUP BY name")
        groups = find("tags", "--by", "action")["groups"]
        self.assertEqual(set(counts.splitlines()),
                         {f"{name}|{group['rows']}|{group['windows']}" for name, group in groups.items()})
        some = shell("psql -At", "SELECT count(*) FROM tags WHERE probability >= 0.5 AND from_time BETWEEN 2 AND 9.5")
        self.assertEqual(int(some), find("tags", "--min-probability", .5, "--where", "from_time>=2", "--where",
                                         "from_time<=9.5", "--limit", 0)["rows"])


def prepare():
    subprocess.run([options.small_model, folder / "small", "4"], check=True)  # its actions are about equally frequent
    for i, name in enumerate(datasets()):
        run("synthesize", name, "--recordings", 3, "--seed", i + 1)
    (folder / "elsewhere").mkdir()
    run("synthesize", "elsewhere/d0", "--recordings", 3, "--seed", 99)
    run("tag", *datasets(), "--model", "small", "-o", "tags")
    run("tag", *datasets(), "--model", "small", "-o", "windows", "--windows")


def main():
    global folder
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuver", required=True, type=os.path.abspath)
    parser.add_argument("--small-model", required=True, type=os.path.abspath)
    _, rest = parser.parse_known_args(namespace=options)
    with tempfile.TemporaryDirectory(prefix="maneuver-fleet-") as made:
        folder = pathlib.Path(made)
        prepare()
        unittest.main(argv=[sys.argv[0], *rest])


if __name__ == "__main__":
    main()
