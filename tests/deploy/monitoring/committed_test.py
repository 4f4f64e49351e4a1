#!/usr/bin/env python3
"""What is committed in deploy/ for monitoring fits together: the dashboard is what its script makes, and readable; every
alert has tests and a place in the documentation; Compose names files and ports that exist.

    committed_test.py
"""

import json
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

import dashboard
from scraped_server import COMPOSE, REPOSITORY, RULES

HERE = pathlib.Path(__file__).resolve().parent
ALERTS = re.findall(r"- alert: (\w+)", (RULES / "alerts.rules.yml").read_text())
METRICS = {name for page in ("metrics_page.txt", "shadow_metrics_page.txt", "outcome_metrics_page.txt")
           for name in re.findall(r"^(\w+)(?:\{.*)?$", (REPOSITORY / "tests/integration" / page).read_text(), re.MULTILINE)}
# Not on the page of a server without TLS, models and PostgreSQL.
METRICS |= {"maneuver_tls_certificate_expiry_timestamp_seconds", "maneuver_model_version", "maneuver_store_available",
            "maneuver_jobs_without_worker", "up",
            # Of a server with --memory-limit.
            "maneuver_memory_bytes", "maneuver_memory_limit_bytes", "maneuver_memory_refusals_total"}


def unknown_metrics(expr):
    names = re.findall(r"\b(?:maneuver|process)_\w+|\bup\b", re.sub(r'"[^"]*"', "", expr))
    return [name for name in names if name not in METRICS]


class DashboardTest(unittest.TestCase):
    def test_it_is_what_the_script_makes(self):
        make = dashboard.FILE.parent / "make.py"
        made = subprocess.run([sys.executable, "-B", make], check=True, capture_output=True, text=True).stdout
        self.assertEqual(made, dashboard.FILE.read_text(), f"{make} > {dashboard.FILE}")

    def test_every_panel_has_a_question_a_unit_and_says_what_to_do(self):
        titles = [panel["title"] for panel in dashboard.panels()]
        self.assertEqual(len(set(titles)), len(titles))
        for panel in dashboard.panels():
            with self.subTest(panel=panel["title"]):
                self.assertGreater(len(panel["description"]), 15)
                self.assertTrue(panel["fieldConfig"]["defaults"]["unit"])
                if panel["type"] != "stat":
                    self.assertTrue(panel["title"].endswith("?"))
                    self.assertTrue(all(target["legendFormat"] for target in panel["targets"]))

    def test_panels_do_not_overlap_and_have_ids_of_their_own(self):
        panels = json.loads(dashboard.FILE.read_text())["panels"]
        self.assertEqual(len({panel["id"] for panel in panels}), len(panels))
        taken = set()
        for panel in panels:
            place = panel["gridPos"]
            self.assertLessEqual(place["x"] + place["w"], 24)
            cells = {(place["x"] + i, place["y"] + j) for i in range(place["w"]) for j in range(place["h"])}
            self.assertFalse(cells & taken, panel["title"])
            taken |= cells

    def test_every_query_asks_for_the_chosen_servers_and_for_metrics_that_exist(self):
        for query in dashboard.queries():
            with self.subTest(panel=query.panel, expr=query.expr):
                dashboard.written_out(query.expr)
                self.assertEqual(unknown_metrics(query.expr), [])
                selectors = re.findall(r"\b(?:(?:maneuver|process)_\w+|up)(\{[^}]*\})?", re.sub(r"\(job, instance\)", "", query.expr))
                for selector in selectors:
                    self.assertIn('job=~"$job", instance=~"$instance"', selector)


class RulesTest(unittest.TestCase):
    def test_promtool_finds_nothing_wrong(self):
        if shutil.which("promtool") is None:
            self.skipTest("promtool is not installed (Debian: prometheus)")
        for command in (["check", "rules", *RULES.glob("*.yml")], ["check", "config", "--syntax-only", COMPOSE / "prometheus.yml"]):
            done = subprocess.run(["promtool", *command], capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_rules_look_at_metrics_that_exist(self):
        for file in RULES.glob("*.yml"):
            for line in file.read_text().splitlines():
                if not re.match(r"\s*(#|description|summary|runbook)", line):
                    self.assertEqual(unknown_metrics(line.replace('job="maneuver"', "")), [], line)

    def test_every_alert_has_a_test_that_it_fires(self):
        tests = [(HERE / name).read_text() for name in ("alerts_test.yml", "alerts_over_days_test.yml")]
        fired = set(re.findall(r"labels: '(?:ALERTS)?\{alertname=\"(\w+)\"", "".join(tests)))
        self.assertEqual(fired, set(ALERTS))

    def test_every_alert_is_in_the_documentation_with_what_to_do(self):
        page = (REPOSITORY / "docs/guides/dashboards.md").read_text()
        documented = re.findall(r"^\| <a id=\"(\w+)\"></a>`(\w+)` \|", page, re.MULTILINE)
        self.assertEqual([name for _, name in documented], ALERTS)
        self.assertEqual([anchor for anchor, _ in documented], [name.lower() for name in ALERTS])
        runbooks = re.findall(r"runbook: (\S+)", (RULES / "alerts.rules.yml").read_text())
        self.assertEqual(runbooks, [f"docs/guides/dashboards.md#{name.lower()}" for name in ALERTS])


class ComposeTest(unittest.TestCase):
    def setUp(self):
        self.text = (COMPOSE / "compose.yaml").read_text()

    def test_what_it_mounts_is_there(self):
        mounted = re.findall(r"- (\.\.?/\S+?):/", self.text)
        self.assertEqual(len(mounted), 6)
        for path in mounted:
            self.assertTrue((COMPOSE / path).exists(), path)

    def test_docker_compose_takes_it(self):
        if shutil.which("docker-compose") is None:
            self.skipTest("docker-compose is not installed")
        done = subprocess.run(["docker-compose", "--file", COMPOSE / "compose.yaml", "config"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        published = re.findall(r"- (\S+)/tcp", done.stdout)
        published = [port for port in published if port != "8443:8443"]  # the edge, which is off by default
        self.assertEqual(len(published), 3)
        self.assertTrue(all(port.startswith("127.0.0.1:") for port in published), published)

    def test_ports_and_folders_agree(self):
        settings = dict(re.findall(r'MANEUVERD_(\w+): "?([^"\n]+)', self.text))
        self.assertEqual(settings["LISTEN"], "0.0.0.0:8470")
        self.assertIn("127.0.0.1:8470:8470", self.text)
        metrics = settings["METRICS_LISTEN"].split(":")[1]
        self.assertIn(f"maneuverd:{metrics}", (COMPOSE / "prometheus.yml").read_text())
        self.assertIn(f"models:{settings['DATA_DIR']}", self.text)
        self.assertIn(f"stop_grace_period: {3 * int(settings['SHUTDOWN_TIMEOUT'])}s", self.text)

    def test_calls_through_the_edge_may_end_before_it_is_killed(self):
        edge = re.search(r"\n  edge:\n((?:    .*\n|\n)+)", self.text)[1]
        patience = int(re.search(r"stop_grace_period: (\d+)s", edge)[1])
        proxy = (REPOSITORY / "deploy/balancing/haproxy.cfg").read_text()
        self.assertGreater(patience, int(re.search(r"hard-stop-after (\d+)s", proxy)[1]))


class ImageTest(unittest.TestCase):
    def test_it_is_built_from_all_that_the_packages_hold(self):
        image = (REPOSITORY / "deploy/container/Dockerfile").read_text()
        copied = [source for line in re.findall(r"^COPY (?!--)(.*)$", image, re.MULTILINE) for source in line.split()[:-1]]
        packing = (REPOSITORY / "deploy/packages/CMakeLists.txt").read_text()
        for source in re.findall(r"\$\{CMAKE_SOURCE_DIR\}/([\w./-]+)", packing):
            self.assertTrue(any(source == each or source.startswith(each + "/") for each in copied), source)


if __name__ == "__main__":
    unittest.main()
