#!/usr/bin/env python3
"""Makes the dashboard of the server.

    deploy/monitoring/grafana/make.py > deploy/monitoring/grafana/maneuver.json
"""

import json

import model_rows
import panel
import process_rows
import serving_rows


def _variable(name, label, label_of, within=""):
    """What servers there are to choose from. All: those that are known, and no other jobs of that Prometheus."""
    values = f"label_values(maneuver_build_info{within}, {label_of})"
    return {"type": "query", "name": name, "label": label, "datasource": panel.DATASOURCE, "definition": values,
            "query": {"qryType": 1, "query": values, "refId": "PrometheusVariableQueryEditor-VariableQuery"},
            "refresh": 2, "sort": 1, "multi": True, "includeAll": True, "options": [],
            "current": {"text": ["All"], "value": ["$__all"]}}


def dashboard():
    swaps = panel.query("sum by (model, alias) (changes(maneuver_model_version{SERVER}[RATE])) > 0")
    return {
        "title": "Maneuver",
        "uid": "maneuver",
        "description": "Predictions, models, jobs and the process of maneuverd. What each alert means: docs/guides/dashboards.md.",
        "tags": ["maneuver"],
        "schemaVersion": 39,
        "version": 1,
        "editable": True,
        "graphTooltip": 1,
        "refresh": "30s",
        "time": {"from": "now-3h", "to": "now"},
        "timezone": "",
        "templating": {"list": [
            {"type": "datasource", "name": "datasource", "label": "Prometheus", "query": "prometheus",
             "refresh": 1, "current": {}, "options": []},
            _variable("job", "Job", "job"),
            _variable("instance", "Server", "instance", '{job=~"$job"}')]},
        "annotations": {"list": [
            {"name": "Swaps", "datasource": panel.DATASOURCE, "enable": True, "iconColor": "purple",
             "expr": swaps["expr"], "titleFormat": "{{model}}@{{alias}}", "textFormat": "stands for another version"}]},
        "panels": panel.lay_out(serving_rows.rows() + model_rows.rows() + process_rows.rows()),
    }


if __name__ == "__main__":
    print(json.dumps(dashboard(), indent=1, ensure_ascii=False))
