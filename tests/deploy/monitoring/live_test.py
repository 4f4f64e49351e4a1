#!/usr/bin/env python3
"""Every query of the dashboard, and everything that alerts look at, against a real Prometheus that scrapes a real
server under load, with training, swaps, a candidate in the shadow, refusals and errors.

    live_test.py FOLDER_OF_THE_PROGRAMS

Exits with 77 where Prometheus is not installed (Debian: prometheus).
"""

import math
import pathlib
import re
import sys
import tempfile
import unittest

import dashboard
from scraped_server import COMPOSE, Prometheus, Server, wait_for

PROGRAMS = None
SKIPPED = 77


def impatient(server, prometheus):
    """Calls whose deadlines are too short, until some were found out in the queue or later."""
    for _ in range(5):
        server.maneuver("load", "--rate", 150, "--deadline", "1-4", "--warm-up", 0, "--duration", 4)
        if any(value > 0 for _, value in prometheus.now('maneuver_dropped_targets_total{cause="expired"}')):
            return


def live(server, prometheus):
    """What servers go through, in half a minute; the alerts that fired while all was well."""
    wait_for("a first scrape", lambda: prometheus.now("up == 1"))
    server.maneuver("dataset", "upload", server.folder / "town", "town")
    server.maneuver("model", "promote", "town/1")
    server.maneuver("model", "promote", "town/2", "--alias", "candidate")
    job = server.train("--promote", "never", "--epochs", 10_000)
    server.maneuver("load", "--rate", 40, "--register-maps", "--warm-up", 0, "--duration", 4)
    # Finite, and later than pretraining.
    learns = "maneuver_training_log_likelihood_nats == maneuver_training_log_likelihood_nats"
    wait_for("a first epoch", lambda: prometheus.now(learns))
    # Twice: rates begin with what a series gains after its first scrape.
    for _ in range(2):
        server.maneuver("outcomes", "report", server.folder / "town", "--model", "town/1", "--set", "examples.stride=2s")
        wait_for("a scrape", lambda: prometheus.now("maneuver_outcome_scored_total > 0"))
    wait_for("shares of outcomes", lambda: prometheus.now("maneuver:outcome_action_share:ratio_1h >= 0"))
    quiet = prometheus.now('ALERTS{alertstate="firing"}')

    # Then all that goes wrong.
    too_much = server.start_maneuver("load", "--concurrency", 48, "--targets", "1-8", "--warm-up", 0, "--duration", 5)
    impatient(server, prometheus)
    server.maneuver("model", "list", token="A" * 43, fails=True)
    server.maneuver("job", "list", token=server.planner, fails=True)
    server.maneuver("load", "--model", "nobody", "--calls", 3, "--warm-up", 0, fails=True)
    server.maneuver("model", "promote", "town/2")
    server.maneuver("model", "promote", "town/1", "--alias", "candidate")
    server.maneuver("job", "cancel", job)
    too_much.wait()
    # Its horizon is longer than the recordings.
    server.maneuver("job", "watch", server.train("--horizon", "60s"), fails=True)
    wait_for("the alert", lambda: prometheus.now('ALERTS{alertname="ManeuverJobFailed", alertstate="firing"}'))
    return quiet


class LiveTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.server = Server(PROGRAMS, cls.folder, ["--workers", "1", "--shadow-fraction", "1", "--max-queue", "64",
                                                  "--outcome-memory", "64KiB", "--memory-limit", "2GiB"])
        cls.addClassCleanup(cls.server.stop)
        cls.prometheus = Prometheus(cls.folder, cls.server.metrics)
        cls.addClassCleanup(cls.prometheus.stop)
        cls.quiet = live(cls.server, cls.prometheus)
        cls.rules = [rule for group in cls.prometheus.get("rules")["groups"] for rule in group["rules"]]

    def test_every_query_of_the_dashboard_has_data(self):
        for query in dashboard.queries():
            with self.subTest(panel=query.panel, expr=query.expr):
                series = self.prometheus.course(dashboard.written_out(query.expr))
                finite = [value for _, values in series for _, value in values if math.isfinite(value)]
                self.assertTrue(finite, "no data")

    def test_what_was_done_is_seen(self):
        """The queries that would be 0 all the time if nothing had happened."""
        seen = {
            'maneuver_targets_total{outcome="refused"}', 'maneuver_dropped_targets_total{cause="expired"}',
            'maneuver_map_lookups_total{result="hit"}', 'maneuver_requests_total{code="NOT_FOUND"}',
            'maneuver_refused_calls_total{reason="TOKEN_UNKNOWN"}', 'maneuver_refused_calls_total{reason="ROLE_MISSING"}',
            'maneuver_model_swaps_total{alias="serving"}', 'maneuver_model_swaps_total{alias="candidate"}',
            'maneuver_shadow_targets_total{outcome="compared"}', 'maneuver_job_ends_total{state="failed"}',
            'maneuver_job_ends_total{state="cancelled"}', 'maneuver_outcome_targets_total{result="scored"}',
            'maneuver_outcome_dropped_answers_total'}
        for series in seen:
            with self.subTest(series=series):
                self.assertTrue(any(value > 0 for _, value in self.prometheus.now(series)))

    def test_all_rules_are_evaluated_without_error(self):
        self.assertGreater(len(self.rules), 30)
        for rule in self.rules:
            with self.subTest(rule=rule["name"]):
                self.assertEqual((rule["health"], rule.get("lastError")), ("ok", None))

    def test_the_server_takes_the_options_of_compose(self):
        options = dict(re.findall(r'(MANEUVERD_\w+): "?([^"\n]+)', (COMPOSE / "compose.yaml").read_text()))
        self.assertGreater(len(options), 3)
        printed = self.server.run("maneuverd", "--print-config", environment=options).stdout
        for name, value in options.items():
            self.assertRegex(printed, f'{name[10:].lower().replace("_", "-")} = "?{value}')

    def test_recorded_rates_have_data(self):
        for rule in self.rules:
            if rule["type"] == "recording":
                with self.subTest(rule=rule["name"]):
                    self.assertTrue(self.prometheus.now(rule["name"]))

    def test_what_rules_look_at_is_there(self):
        """Each metric with each of its labels; of codes that no call ended with, the label alone."""
        only_with_postgresql = {"maneuver_store_available", "maneuver_jobs_without_worker"}
        for rule in self.rules:
            for metric, matchers in re.findall(r"((?:maneuver|process)[:_\w]+|\bup)(\{[^}]*\})?", rule["query"]):
                if metric in only_with_postgresql:
                    continue
                matchers = re.sub(r'code=~"[A-Z_|]+"', 'code!=""', matchers)
                with self.subTest(rule=rule["name"], series=metric + matchers):
                    self.assertTrue(self.prometheus.now(metric + matchers))

    def test_no_alert_fires_in_health_and_a_job_that_fails_is_told(self):
        self.assertEqual(self.quiet, [])
        alerts = self.prometheus.get("alerts")["alerts"]
        told = {alert["labels"]["alertname"]: alert["annotations"] for alert in alerts if alert["state"] == "firing"}
        self.assertNotIn("ManeuverDown", told)
        self.assertEqual(told["ManeuverJobFailed"]["summary"], f"A job failed on {self.server.metrics}")


if __name__ == "__main__":
    PROGRAMS = sys.argv.pop(1)
    if not Prometheus.is_installed():
        print("skipped: prometheus is not installed (deploy/install-deps.sh --tests installs it)")
        sys.exit(SKIPPED)
    unittest.main()
