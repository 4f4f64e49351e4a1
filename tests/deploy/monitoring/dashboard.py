"""The dashboard as Grafana would read it."""

import collections
import json
import pathlib

FILE = pathlib.Path(__file__).resolve().parents[3] / "deploy/monitoring/grafana/maneuver.json"

Query = collections.namedtuple("Query", "panel expr")


def panels():
    return [panel for panel in json.loads(FILE.read_text())["panels"] if panel["type"] != "row"]


def written_out(expr, rate_interval="10s"):
    """With values for Grafana's variables."""
    # Not $__interval: changes and rates between two points would get lost, or all of them where it is a single scrape.
    for variable, value in (("$__rate_interval", rate_interval), ("$job", ".*"), ("$instance", ".*")):
        expr = expr.replace(variable, value)
    if "$" in expr:
        raise ValueError(f"a variable that nobody knows: {expr}")
    return expr


def queries():
    """All that the dashboard asks, its annotations too."""
    asked = [Query(panel["title"], target["expr"]) for panel in panels() for target in panel["targets"]]
    annotations = json.loads(FILE.read_text())["annotations"]["list"]
    return asked + [Query(f"annotation {each['name']}", each["expr"]) for each in annotations]
