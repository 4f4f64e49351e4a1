"""Panels of a Grafana dashboard: what one asks, in which unit, and what to do about the answer."""

import itertools

DATASOURCE = {"type": "prometheus", "uid": "${datasource}"}
WIDTH = 24  # columns of Grafana's grid

# Which servers: every selector of every query has these, in place of SERVER.
SERVER = 'job=~"$job", instance=~"$instance"'

_PALETTE = {"mode": "palette-classic"}


def query(expr, legend="", **more):
    """One query; SERVER and RATE in it are written out."""
    expr = " ".join(expr.split()).replace("SERVER", SERVER).replace("RATE", "$__rate_interval")
    return {"datasource": DATASOURCE, "expr": expr, "legendFormat": legend, **more}


def _thresholds(steps):
    """steps: [(from, colour)], the first from nothing."""
    return {"mode": "absolute",
            "steps": [{"color": colour, "value": value} for value, colour in steps]}


def _panel(kind, title, description, queries, unit, width, height, options, defaults):
    targets = [{"refId": chr(ord("A") + i), **each} for i, each in enumerate(queries)]
    return {"type": kind, "title": title, "description": description, "datasource": DATASOURCE,
            "targets": targets, "gridPos": {"w": width, "h": height},
            "fieldConfig": {"defaults": {"unit": unit, **defaults}, "overrides": []},
            "options": options}


def curves(title, description, queries, unit, width=8, height=8, stacked=False, steps=False,
           orders=False, least=None, most=None, limit=None):
    """Lines over time. orders: by orders of magnitude, of either sign. limit: a red line at what should not be passed."""
    custom = {"drawStyle": "line", "lineWidth": 1, "fillOpacity": 25 if stacked else 8,
              "lineInterpolation": "stepAfter" if steps else "linear",
              "showPoints": "never", "spanNulls": False,
              "stacking": {"mode": "normal" if stacked else "none", "group": "A"},
              "thresholdsStyle": {"mode": "line" if limit is not None else "off"}}
    if orders:
        custom["scaleDistribution"] = {"type": "symlog", "log": 10, "linearThreshold": 1}
    defaults = {"color": _PALETTE, "custom": custom}
    if least is not None:
        defaults["min"] = least
    if most is not None:
        defaults["max"] = most
    if limit is not None:
        defaults["thresholds"] = _thresholds([(None, "green"), (limit, "red")])
    options = {"legend": {"displayMode": "list", "placement": "bottom", "showLegend": True},
               "tooltip": {"mode": "multi", "sort": "desc"}}
    return _panel("timeseries", title, description, queries, unit, width, height, options, defaults)


def number(title, description, expr, unit, thresholds=None, width=3, height=4):
    """One figure, in the colour of its threshold, with its course behind it."""
    defaults = {"color": {"mode": "thresholds"},
                "thresholds": _thresholds(thresholds or [(None, "blue")])}
    options = {"reduceOptions": {"calcs": ["lastNotNull"], "fields": "", "values": False},
               "colorMode": "value", "graphMode": "area", "textMode": "value",
               "justifyMode": "center", "orientation": "auto"}
    return _panel("stat", title, description, [query(expr)], unit, width, height, options, defaults)


def heatmap(title, description, expr, unit, width=8, height=8):
    """How many observations were in each bucket of a histogram; expr: by le."""
    options = {"calculate": False, "cellGap": 1, "legend": {"show": True},
               "color": {"mode": "scheme", "scheme": "Oranges", "scale": "exponential", "exponent": 0.5, "steps": 64,
                         "fill": "dark-orange", "reverse": False},
               "rowsFrame": {"layout": "auto"},
               "yAxis": {"unit": unit, "axisPlacement": "left"},
               "tooltip": {"mode": "single", "show": True}, "filterValues": {"le": 1e-9}}
    return _panel("heatmap", title, description, [query(expr, "{{le}}", format="heatmap")], unit,
                  width, height, options, {})


def row(title, *panels):
    return {"type": "row", "title": title, "collapsed": False, "panels": [],
            "gridPos": {"w": WIDTH, "h": 1}}, panels


def lay_out(rows):
    """The panels of all rows from left to right and top to bottom, each with a place and an id."""
    placed, y = [], 0
    for heading, panels in rows:
        placed.append(heading)
        heading["gridPos"] |= {"x": 0, "y": y}
        y += 1
        x = line = 0
        for panel in panels:
            place = panel["gridPos"]
            if x + place["w"] > WIDTH:
                x, y, line = 0, y + line, 0
            place |= {"x": x, "y": y}
            x, line = x + place["w"], max(line, place["h"])
            placed.append(panel)
        y += line
    for number_, panel in zip(itertools.count(1), placed):
        panel["id"] = number_
    return placed
