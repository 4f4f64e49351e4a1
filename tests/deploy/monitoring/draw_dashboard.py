#!/usr/bin/env python3
"""Draws rows of the dashboard from recorded series, much as Grafana would, as an SVG.

    draw_dashboard.py SERIES.json OUTPUT.svg [ROW...]       the series: record_story.py
    rsvg-convert OUTPUT.svg --output dashboard.png && pngquant --output docs/pictures/dashboard.png 64 dashboard.png

ROW: titles of rows, or how they begin; without them all are drawn.
"""

import html
import json
import math
import pathlib
import re
import sys

import dashboard

COLUMN, LINE, GAP = 60, 27, 4  # pixels of the grid
BACKGROUND, PANEL, EDGE = "#111217", "#181b1f", "#24272c"
TEXT, FAINT = "#ccccdc", "#8e8e99"
PALETTE = ["#73bf69", "#f2cc0c", "#8ab8ff", "#ff780a", "#f2495c", "#5794f2", "#b877d9", "#705da0", "#37872d", "#fade2a"]
NAMED = {"green": "#73bf69", "orange": "#ff9830", "red": "#f2495c", "blue": "#5794f2"}
FONT = 'font-family="DejaVu Sans, sans-serif"'


def shown(value, unit):
    """A value as a person reads it."""
    if unit == "percentunit":
        return f"{value * 100:.3g} %"
    if unit == "s":
        for size, name in ((86400, "d"), (3600, "h"), (60, "min")):
            if abs(value) >= 1.5 * size:
                return f"{value / size:.3g} {name}"
        return "0 s" if value == 0 else f"{value:.3g} s" if abs(value) >= 1 else f"{value * 1e3:.3g} ms"
    if unit in ("bytes", "Bps"):
        power = min(4, int(math.log(max(abs(value), 1), 1024)))
        return f"{value / 1024 ** power:.3g} {['B', 'KiB', 'MiB', 'GiB', 'TiB'][power]}" + ("/s" if unit == "Bps" else "")
    scaled = f"{value / 1000:.3g} k" if abs(value) >= 1e4 else f"{value:.4g}"
    return scaled + {"reqps": "/s", "lengthm": " m"}.get(unit, "")


def text(x, y, words, size=11, colour=TEXT, anchor="start", weight="normal"):
    return (f'<text x="{x:.1f}" y="{y:.1f}" {FONT} font-size="{size}" fill="{colour}" text-anchor="{anchor}" '
            f'font-weight="{weight}">{html.escape(words)}</text>')


def ticks(low, high, unit, wanted=4):
    if unit in ("bytes", "Bps") and high > 1024:
        size = 1024 ** int(math.log(high, 1024))
        return [size * tick for tick in ticks(low / size, high / size, "", wanted)]
    rough = (high - low) / wanted
    power = 10 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 2.5, 5, 10) if factor * power >= rough * 0.999)
    return [step * i for i in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def magnitude(value):
    """Grafana's symlog: straight up to 1, orders of magnitude beyond, of either sign."""
    return value if abs(value) <= 1 else math.copysign(1 + math.log10(abs(value)), value)


def orders(low, high):
    """Ticks of that scale, as they are placed and as they are."""
    powers = [10.0 ** power for power in range(12)]
    return [tick for tick in [-power for power in reversed(powers)] + [0] + powers if low <= magnitude(tick) <= high]


def legend_of(target, labels):
    legend = target["legendFormat"]
    for name, value in labels.items():
        legend = legend.replace("{{" + name + "}}", value)
    return re.sub(r"127\.0\.0\.1:\d+", "server", legend).strip()


class Drawing:
    def __init__(self, recorded):
        self.recorded, self.parts = recorded, []
        times = [at for series in recorded["courses"].values() for each in series for at, _ in each["values"]]
        self.start, self.end = min(times), max(times)

    def series(self, panel):
        """[(legend, [(time, value or None)])] of all queries."""
        found = [(legend_of(target, each["labels"]), each["values"])
                 for target in panel["targets"] for each in self.recorded["courses"][target["expr"]]]
        return [(legend, values) for legend, values in found if any(value is not None for _, value in values)]

    def line(self, x1, y1, x2, y2, colour=EDGE, dashes=""):
        self.parts.append(f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" '
                          f'stroke-dasharray="{dashes}"/>')

    def path(self, points, colour, floor=None, opacity=1.0):
        """A line through the points or, with a floor, the area between both."""
        path = " ".join(f"{'ML'[i > 0]}{x:.1f} {y:.1f}" for i, (x, y) in enumerate(points))
        if floor is None:
            self.parts.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.3" stroke-opacity="{opacity}"/>')
        else:
            path += f" L{points[-1][0]:.1f} {floor:.1f} L{points[0][0]:.1f} {floor:.1f} Z"
            self.parts.append(f'<path d="{path}" fill="{colour}" fill-opacity="{opacity}"/>')

    def frame(self, x, y, panel):
        place = panel["gridPos"]
        width, height = place["w"] * COLUMN - GAP, place["h"] * LINE - GAP
        self.parts.append(f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="2" fill="{PANEL}" stroke="{EDGE}"/>')
        title, size = panel["title"], 12
        if len(title) * 7.6 > width - 16:
            size = 12 * (width - 16) / (len(title) * 7.6)
        self.parts.append(text(x + 8, y + 18, title, size, weight="bold"))
        return width, height

    def segments(self, values, step):
        """Runs of neighbouring points."""
        run = []
        for at, value in values:
            if value is None or (run and at - run[-1][0] > 2.5 * step):
                if run:
                    yield run
                run = []
            if value is not None:
                run.append((at, value))
        if run:
            yield run

    def time_axis(self, x, y, width, height):
        for minute in range(0, int((self.end - self.start) / 60) + 1, 2):
            at = x + width * minute * 60 / (self.end - self.start)
            self.line(at, y, at, y + height)
            self.parts.append(text(at, y + height + 13, f"{minute} min", 9, FAINT, "middle"))

    def curves(self, x, y, panel):
        width, height = self.frame(x, y, panel)
        defaults = panel["fieldConfig"]["defaults"]
        custom, unit = defaults["custom"], defaults["unit"]
        series = self.series(panel)
        stacked = custom["stacking"]["mode"] == "normal"
        if stacked:
            series = self.stack(series)
        scale, ticks_of = (magnitude, orders) if "scaleDistribution" in custom else (float, lambda a, b: ticks(a, b, unit))
        values = [scale(value) for _, course in series for _, value in course if value is not None]
        low = min(values + [defaults["min"]] if "min" in defaults else values)
        high = max(values + [defaults["max"]] if "max" in defaults else values)
        limit = defaults["thresholds"]["steps"][-1]["value"] if custom["thresholdsStyle"]["mode"] == "line" else None
        if limit is not None and limit < 3 * high:
            high = max(high, limit)
        high = high + 0.06 * (high - low) if high > low else low + 1
        legends = self.legend(x + 8, y + height - 6, width - 16, series)
        left, top, right, bottom = x + 58, y + 30, x + width - 12, y + height - 18 - 14 * legends
        put_y = lambda value: bottom - (bottom - top) * (scale(value) - low) / (high - low)
        put_x = lambda at: left + (right - left) * (at - self.start) / (self.end - self.start)
        self.time_axis(left, top, right - left, bottom - top)
        for tick in ticks_of(low, high):
            self.line(left, put_y(tick), right, put_y(tick))
            self.parts.append(text(left - 6, put_y(tick) + 3, shown(tick, unit), 9, FAINT, "end"))
        if limit is not None and limit <= high:
            self.line(left, put_y(limit), right, put_y(limit), NAMED["red"], "5 4")
        order = list(enumerate(series))
        for i, (_, course) in reversed(order) if stacked else order:
            colour = PALETTE[i % len(PALETTE)]
            for run in self.segments(course, self.recorded["step"]):
                points = [(put_x(at), put_y(value)) for at, value in run]
                if custom["lineInterpolation"] == "stepAfter":
                    points = [corner for a, b in zip(points, points[1:] + points[-1:]) for corner in (a, (b[0], a[1]))]
                if stacked:
                    self.path(points, PANEL, bottom)
                self.path(points, colour, bottom, custom["fillOpacity"] / 100)
                self.path(points, colour)

    def stack(self, series):
        stacked, below = [], {}
        for legend, course in series:
            below.update({at: below.get(at, 0.0) + (value or 0.0) for at, value in course})
            stacked.append((legend, [(at, below[at]) for at, _ in course]))
        return stacked

    def legend(self, x, y, width, series):
        """Draws it upwards from y; how many lines it took."""
        lines, used = [[]], 0
        for i, (words, _) in enumerate(series[:12]):
            words = words if len(words) < 44 else words[:42] + "…"
            size = 22 + 5.9 * len(words)
            if used + size > width and lines[-1]:
                lines.append([])
                used = 0
            lines[-1].append((used, words, PALETTE[i % len(PALETTE)]))
            used += size
        for i, line in enumerate(lines):
            at = y - 14 * (len(lines) - 1 - i)
            for offset, words, colour in line:
                self.parts.append(f'<rect x="{x + offset:.1f}" y="{at - 6}" width="10" height="3" rx="1" fill="{colour}"/>')
                self.parts.append(text(x + offset + 14, at, words, 10, FAINT))
        return len(lines)

    def number(self, x, y, panel):
        width, height = self.frame(x, y, panel)
        defaults = panel["fieldConfig"]["defaults"]
        course = [(at, value) for at, value in self.series(panel)[0][1] if value is not None]
        last = course[-1][1]
        colour = [step["color"] for step in defaults["thresholds"]["steps"] if step["value"] is None or last >= step["value"]][-1]
        colour = NAMED[colour]
        low, high = min(value for _, value in course), max(value for _, value in course)
        if high > low:
            points = [(x + 1 + (width - 2) * (at - self.start) / (self.end - self.start),
                       y + height - 2 - 0.36 * height * (value - low) / (high - low)) for at, value in course]
            self.path(points, colour, y + height - 1, 0.15)
            self.path(points, colour, opacity=0.7)
        self.parts.append(text(x + width / 2, y + height / 2 + 16, shown(last, defaults["unit"]), 24, colour, "middle", "bold"))

    def heatmap(self, x, y, panel):
        width, height = self.frame(x, y, panel)
        left, top, right, bottom = x + 58, y + 30, x + width - 12, y + height - 24
        buckets = sorted(((float(each["labels"]["le"].replace("+Inf", "inf")), dict(map(tuple, each["values"])))
                          for each in self.recorded["courses"][panel["targets"][0]["expr"]]), key=lambda bucket: bucket[0])
        cells = {}
        for i, (bound, course) in enumerate(buckets):
            for at, value in course.items():
                below = buckets[i - 1][1].get(at, 0.0) or 0.0 if i else 0.0
                if value is not None and value - below > 1e-9:
                    cells[(at, i)] = value - below
        used = [i for _, i in cells]
        first, last, most = max(min(used) - 1, 0), max(used), max(cells.values())
        row = (bottom - top) / (last - first + 1)
        second = (right - left) / (self.end - self.start)
        put_y = lambda i: bottom - row * (i - first + 1)
        for (at, i), value in cells.items():
            strength = math.sqrt(value / most)
            colour = ",".join(str(int(low + (high - low) * strength)) for low, high in ((60, 255), (35, 190), (20, 110)))
            self.parts.append(f'<rect x="{left + second * (at - self.start):.1f}" y="{put_y(i) + 0.5:.1f}" '
                              f'width="{second * self.recorded["step"]:.2f}" height="{row - 1:.1f}" fill="rgb({colour})"/>')
        for i in range(first, last + 1, math.ceil(11 / row)):
            if math.isfinite(buckets[i][0]):
                unit = panel["fieldConfig"]["defaults"]["unit"]
                self.parts.append(text(left - 6, put_y(i) + 4, shown(buckets[i][0], unit), 9, FAINT, "end"))
        self.time_axis(left, top, right - left, bottom - top)

    def panel(self, x, y, panel):
        if not self.series(panel):
            width, height = self.frame(x, y, panel)
            self.parts.append(text(x + width / 2, y + height / 2, "No data", 14, FAINT, "middle"))
            return
        draw = {"timeseries": self.curves, "stat": self.number, "heatmap": self.heatmap}[panel["type"]]
        draw(x, y, panel)

    def svg(self, wanted):
        y = GAP
        chosen, above = False, 0
        for panel in json.loads(dashboard.FILE.read_text())["panels"]:
            place = panel["gridPos"]
            if panel["type"] == "row":
                if chosen:
                    y += (place["y"] - above) * LINE
                chosen = not wanted or any(panel["title"].startswith(title) for title in wanted)
                above = place["y"]
                if chosen:
                    self.parts.append(text(10, y + 18, "▾ " + panel["title"], 14, TEXT, weight="bold"))
            if chosen:
                bottom = y + (place["y"] + place["h"] - above) * LINE
                if panel["type"] != "row":
                    self.panel(GAP + place["x"] * COLUMN, y + (place["y"] - above) * LINE, panel)
        width, height = 24 * COLUMN + GAP, bottom
        return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">'
                f'<rect width="{width}" height="{height}" fill="{BACKGROUND}"/>{"".join(self.parts)}</svg>\n')


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    drawing = Drawing(json.loads(pathlib.Path(sys.argv[1]).read_text()))
    pathlib.Path(sys.argv[2]).write_text(drawing.svg(sys.argv[3:]))
