"""Charts of success with intervals, of distributions and of shares, as SVG.

Shapes have class names, so that a style sheet sets light and dark. A navigator has one colour
everywhere (Okabe and Ito's colour-blind-safe set); passing on the right is dashed. Numbers are
rounded and nothing depends on time, so that equal drawings are equal bytes.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from math import floor, isfinite, log10
from typing import Final, TypeAlias

import numpy as np

from study.intervals import Floats, Proportion

COLOURS: Final = {
    "bug": ("#d55e00", "#ff8a3d"),
    "vgm": ("#b8860b", "#e6b422"),
    "bug1": ("#009e73", "#2fc99b"),
    "bug2": ("#3a9bd9", "#7cc4f2"),
    "distbug": ("#b0569a", "#df8fc9"),
    "vgm_memory": ("#0054a6", "#5b9dff"),
    "other": ("#5c5c5c", "#b5b5b5"),
}
"""Colour on a light and on a dark background."""


def colour(label: str) -> str:
    """Return the colour name of a navigator from its label."""
    name = label.partition(",")[0]
    return name if name in COLOURS else "other"


def dashed(label: str) -> str:
    """Return the class of a dashed line for passing on the right, else nothing."""
    return " right" if ", right" in label else ""


def _variables(which: int) -> str:
    return "".join(f"--{name}:{pair[which]};" for name, pair in COLOURS.items())


LIGHT: Final = (
    "--ink:#1c1e21;--soft:#5d636b;--rule:#d5d9de;--paper:#ffffff;--panel:#f5f6f8;"
    "--solid:#9aa1aa;--good:#00684a;--bad:#b3261e;--open:#7a5d00;--warm:213,94,0;--cool:0,84,166;"
    + _variables(0)
)
DARK: Final = (
    "--ink:#e7e9ec;--soft:#a3a9b2;--rule:#3a3f46;--paper:#15171a;--panel:#1e2125;"
    "--solid:#697079;--good:#4cc38a;--bad:#ff8d84;--open:#e2b93b;--warm:255,138,61;"
    "--cool:91,157,255;" + _variables(1)
)

_NAVIGATORS: Final = "".join(
    f".l-{name}{{stroke:var(--{name})}}.f-{name}{{fill:var(--{name})}}" for name in COLOURS
)

DRAWING_RULES: Final = (
    ".drawing{font:11px system-ui,'Segoe UI','DejaVu Sans',sans-serif}"
    ".drawing .ground{fill:var(--paper)}"
    ".drawing .label{fill:var(--ink)}.drawing .small{fill:var(--soft);font-size:10px}"
    ".drawing .head{fill:var(--ink);font-weight:600;font-size:12px}"
    ".drawing .on{fill:var(--paper);font-size:10px}"
    ".drawing .axis{stroke:var(--soft)}.drawing .grid{stroke:var(--rule)}"
    ".drawing .wanted{stroke:var(--ink);stroke-dasharray:2 3}"
    ".drawing .solid{fill:var(--solid)}.drawing .solidline{stroke:var(--solid);fill:none;"
    "stroke-linejoin:round;stroke-linecap:round}"
    ".drawing .mover{fill:var(--solid);fill-opacity:.35;stroke:var(--solid);stroke-dasharray:3 2}"
    ".drawing .moverline{stroke:var(--solid);stroke-dasharray:3 2;fill:none}"
    ".drawing .rim{fill:var(--panel);stroke:var(--solid);stroke-width:1.5}"
    ".drawing .way{fill:none;stroke-width:1.7;stroke-linejoin:round;stroke-linecap:round}"
    ".drawing .faint{opacity:.45;stroke-width:1}"
    ".drawing .right{stroke-dasharray:6 3}"
    ".drawing .believed{fill:none;stroke:var(--ink);stroke-width:1.1;stroke-dasharray:1.5 2.5}"
    ".drawing .doubt{fill:none;stroke:var(--ink);stroke-width:1.1}"
    ".drawing .straight{stroke:var(--soft);stroke-dasharray:5 4}"
    ".drawing .mark{stroke:var(--paper);stroke-width:1}"
    ".drawing .goal{fill:none;stroke:var(--ink);stroke-width:1.4}"
    ".drawing .start{fill:var(--ink)}"
    ".drawing .cross{stroke:var(--bad);stroke-width:2.2}"
    ".drawing .whisker{stroke-width:2}.drawing .thin{stroke-width:1.4;fill:none}"
    ".drawing .o-reached{fill:var(--vgm_memory)}.drawing .o-collided{fill:var(--bug)}"
    ".drawing .o-stuck{fill:var(--distbug)}.drawing .o-timeout{fill:var(--vgm)}"
    ".drawing .o-unreachable{fill:var(--bug2)}.drawing .o-lost{fill:var(--bug1)}"
    ".drawing .o-aborted{fill:var(--other)}.drawing .o-goal{fill:var(--bug2)}"
    ".drawing .o-left{fill:var(--bug1)}.drawing .o-right{fill:var(--distbug)}"
    ".drawing .o-align{fill:var(--vgm)}.drawing .o-other{fill:var(--other)}" + _NAVIGATORS
)

DRAWING_STYLE: Final = (
    f":root{{{LIGHT}}}@media(prefers-color-scheme:dark){{:root{{{DARK}}}}}{DRAWING_RULES}"
)

PAGE_STYLE: Final = (
    f":root{{color-scheme:light dark;{LIGHT}}}"
    f"@media(prefers-color-scheme:dark){{:root{{{DARK}}}}}"
    f":root[data-colours=light]{{color-scheme:light;{LIGHT}}}"
    f":root[data-colours=dark]{{color-scheme:dark;{DARK}}}"
    "header{display:flex;gap:1rem;align-items:baseline;justify-content:space-between}"
    "header button{font:inherit;font-size:.85rem;color:var(--soft);background:var(--panel);"
    "border:1px solid var(--rule);border-radius:.3rem;padding:.2rem .6rem;cursor:pointer}"
    "summary{cursor:pointer;color:var(--soft);font-size:.92rem;max-width:48rem;padding:.35rem 0}"
    "summary h3{display:inline;color:var(--ink)}details{margin:.5rem 0}"
    "th.sorts{cursor:pointer}th[aria-sort=ascending]::after{content:' \\25b2'}"
    "th[aria-sort=descending]::after{content:' \\25bc'}"
    "#verdict p{font-size:1.08rem}"
    "*{box-sizing:border-box}body{margin:0 auto;max-width:76rem;padding:1.5rem 1.25rem 4rem;"
    "background:var(--paper);color:var(--ink);"
    "font:16px/1.5 system-ui,'Segoe UI','DejaVu Sans',sans-serif}"
    "h1{font-size:1.75rem;line-height:1.2;margin:.5rem 0 1rem}"
    "h2{font-size:1.3rem;margin:2.75rem 0 .75rem;padding-top:.5rem;"
    "border-top:1px solid var(--rule)}"
    "h3{font-size:1.08rem;margin:1.75rem 0 .5rem}p,li{max-width:48rem}"
    "nav{background:var(--panel);padding:.6rem 1rem;border-radius:.4rem;font-size:.92rem}"
    "nav ol{margin:0;padding-left:1.25rem;columns:16rem}nav li{max-width:none}"
    "a{color:var(--vgm_memory)}code,pre{font-family:ui-monospace,'DejaVu Sans Mono',monospace;"
    "font-size:.86em;background:var(--panel);border-radius:.2rem}code{padding:.05em .3em}"
    "pre{padding:.6rem .8rem;overflow-x:auto;white-space:pre}pre code{padding:0}"
    ".wide{overflow-x:auto;margin:1rem 0}table{border-collapse:collapse;font-size:.88rem;"
    "font-variant-numeric:tabular-nums}caption{caption-side:top;text-align:left;"
    "padding:0 0 .4rem;color:var(--soft);max-width:min(48rem,90vw)}"
    "th,td{padding:.28rem .6rem;border-bottom:1px solid var(--rule);text-align:left;"
    "vertical-align:top}thead th{border-bottom:2px solid var(--soft);vertical-align:bottom}"
    "th{font-weight:600}tbody th{font-weight:500}"
    "td.figure,th.figure{text-align:right}td.figure,th.short{white-space:nowrap}"
    "thead th{max-width:9rem}"
    ".good{color:var(--good);font-weight:600}.bad{color:var(--bad);font-weight:600}"
    ".open{color:var(--open);font-weight:600}.none{color:var(--soft)}"
    "figure{margin:1rem 0}figcaption{font-size:.88rem;color:var(--soft);max-width:48rem;"
    "margin-top:.35rem}svg.drawing{max-width:100%;height:auto;display:block}"
    "section>figure{overflow-x:auto}section>figure svg.drawing{min-width:36rem}"
    ".gallery{display:grid;grid-template-columns:repeat(auto-fill,minmax(20rem,1fr));gap:1.25rem}"
    ".gallery figure{margin:0;min-width:0}.gallery pre{font-size:.72rem;margin:.3rem 0 0}"
    "@media print{nav{display:none}figure,tr{break-inside:avoid}}"
)


Dot: TypeAlias = tuple[float, float]


class SvgDrawing:
    """A drawing in pixels, y downwards; `title` is read out by screen readers."""

    __slots__ = ("_parts", "height", "title", "width")

    def __init__(self, width: float, height: float, title: str) -> None:
        self.width, self.height, self.title = width, height, title
        self._parts: list[str] = []

    def line(self, a: Dot, b: Dot, kind: str) -> None:
        """Draw a line."""
        (x1, y1), (x2, y2) = a, b
        self._add("line", kind, f'x1="{n(x1)}" y1="{n(y1)}" x2="{n(x2)}" y2="{n(y2)}"')

    def polyline(self, dots: Iterable[Dot], kind: str) -> None:
        """Draw an open polygon."""
        self._add("polyline", kind, f'points="{_points(dots)}"')

    def polygon(self, dots: Iterable[Dot], kind: str) -> None:
        """Draw a filled polygon."""
        self._add("polygon", kind, f'points="{_points(dots)}"')

    def rectangle(self, corner: Dot, width: float, height: float, kind: str) -> None:
        """Draw a rectangle from its upper left corner."""
        size = f'width="{n(max(0.0, width))}" height="{n(max(0.0, height))}"'
        self._add("rect", kind, f'x="{n(corner[0])}" y="{n(corner[1])}" {size}')

    def circle(self, centre: Dot, radius: float, kind: str) -> None:
        """Draw a circle."""
        self._add("circle", kind, f'cx="{n(centre[0])}" cy="{n(centre[1])}" r="{n(radius)}"')

    def ellipse(self, centre: Dot, radii: Dot, degrees: float, kind: str) -> None:
        """Draw an ellipse, turned clockwise by `degrees`."""
        (x, y), (rx, ry) = centre, radii
        turned = f'transform="rotate({n(degrees)} {n(x)} {n(y)})"'
        shape = f'cx="{n(x)}" cy="{n(y)}" rx="{n(rx)}" ry="{n(ry)}"'
        self._add("ellipse", kind, f"{shape} {turned}")

    def text(self, at: Dot, words: str, kind: str = "label", anchor: str = "start") -> None:
        """Draw text."""
        place = f'x="{n(at[0])}" y="{n(at[1])}" text-anchor="{anchor}"'
        self._parts.append(f'<text class="{kind}" {place}>{escape(words)}</text>')

    def inline(self) -> str:
        """Return the SVG element for a page that contains the style."""
        box = f'viewBox="0 0 {n(self.width)} {n(self.height)}" width="{n(self.width)}"'
        title = f"<title>{escape(self.title)}</title>"
        return f'<svg class="drawing" role="img" {box}>{title}{"".join(self._parts)}</svg>'

    def alone(self) -> str:
        """Return a file with its own style."""
        width, height = n(self.width), n(self.height)
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" role="img" '
            f'viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
        )
        ground = f'<rect class="ground" width="{width}" height="{height}"/>'
        body = "\n".join(self._parts)
        title = f"<title>{escape(self.title)}</title>"
        return f"{head}\n{title}<style>{DRAWING_STYLE}</style>{ground}\n{body}\n</svg>\n"

    def _add(self, shape: str, kind: str, places: str) -> None:
        self._parts.append(f'<{shape} class="{kind}" {places}/>')


def n(value: float) -> str:
    """Format a coordinate with one decimal at most; never `-0`."""
    return f"{round(value, 1) + 0.0:g}" if abs(value) < 1e5 else f"{value:.0f}"


def _points(dots: Iterable[Dot]) -> str:
    return " ".join(f"{n(x)},{n(y)}" for x, y in dots)


NAMES: Final = 118.0
PANEL: Final = 210.0
GAP: Final = 34.0
ROW: Final = 22.0
TOP: Final = 26.0
MAX_DOTS: Final = 80

Panels = Mapping[str, Mapping[str, Proportion]]


def success_chart(panels: Panels, labels: Sequence[str], alt_text: str) -> SvgDrawing:
    """Draw a panel per noise level, a row per navigator: rate and interval from 0 to 100 %."""
    height = TOP + ROW * len(labels) + 24.0
    drawing = SvgDrawing(NAMES + (PANEL + GAP) * len(panels), height, alt_text)
    for row, label in enumerate(labels):
        drawing.text((NAMES - 10, _row(row) + 4), label, anchor="end")
    for column, (title, panel) in enumerate(panels.items()):
        left = NAMES + column * (PANEL + GAP)
        drawing.text((left, 14), title, "head")
        for percent in (0, 25, 50, 75, 100):
            x = left + PANEL * percent / 100
            drawing.line((x, TOP), (x, height - 20), "grid")
            drawing.text((x, height - 6), f"{percent}", "small", "middle")
        for row, label in enumerate(labels):
            if label in panel and panel[label].of:
                _whisker(drawing, left, _row(row), label, panel[label])
    return drawing


def _row(row: int) -> float:
    return TOP + ROW * (row + 0.5)


def _whisker(drawing: SvgDrawing, left: float, y: float, label: str, found: Proportion) -> None:
    low, high = found.interval
    ends = (left + PANEL * low, y), (left + PANEL * high, y)
    drawing.line(*ends, f"whisker l-{colour(label)}")
    drawing.circle((left + PANEL * found.rate, y), 4.0, f"mark f-{colour(label)}")


def bars(
    rows: Mapping[str, Mapping[str, float]], kinds: Mapping[str, str], alt_text: str
) -> SvgDrawing:
    """Draw a bar per row of shares that add up to 1; `kinds` are the class names of the parts."""
    names, width = 200.0, 560.0
    drawing = SvgDrawing(names + width + 12, TOP + 19.0 * len(rows) + 6, alt_text)
    x = names
    for part, kind in kinds.items():
        drawing.rectangle((x, 4), 11, 11, kind)
        drawing.text((x + 15, 13.5), part, "small")
        x += 30 + 6.2 * len(part)
    for row, (label, parts) in enumerate(rows.items()):
        y, x = TOP + 19.0 * row, names
        drawing.text((names - 10, y + 11), label, anchor="end")
        for part, kind in kinds.items():
            wide = width * parts.get(part, 0.0)
            if wide <= 0.0:
                continue
            drawing.rectangle((x, y), wide, 15, kind)
            if wide > 34:
                drawing.text((x + wide / 2, y + 11), f"{parts[part]:.0%}", "on", "middle")
            x += wide
    return drawing


def distribution_chart(
    panels: Mapping[str, Mapping[str, Floats]],
    alt_text: str,
    x_title: str,
    ends: tuple[float, float],
    wanted: Callable[[str], Sequence[float]] = lambda _: (),
) -> SvgDrawing:
    """Draw cumulative distributions on a logarithmic axis, a panel per noise level.

    `wanted` gives the values at which a panel has a dotted line.
    """
    labels = list(dict.fromkeys(label for panel in panels.values() for label in panel))
    high, across, left = 150.0, min(4, max(1, len(panels))), 40.0
    down = -(-len(panels) // across)
    legend = 22.0
    drawing = SvgDrawing(left + (PANEL + GAP) * across, legend + (high + 62) * down, alt_text)
    _legend(drawing, labels, left)
    for place, (title, panel) in enumerate(panels.items()):
        corner = (
            left + (place % across) * (PANEL + GAP),
            legend + 24 + (place // across) * (high + 62),
        )
        _frame(drawing, corner, high, title, x_title, ends, place % across == 0)
        for value in wanted(title):
            x = corner[0] + PANEL * _along(value, ends)
            drawing.line((x, corner[1]), (x, corner[1] + high), "wanted")
        for label, values in panel.items():
            dots = [
                (corner[0] + PANEL * _along(value, ends), corner[1] + high * (1 - share))
                for value, share in steps(values)
            ]
            if dots:
                drawing.polyline(dots, f"way l-{colour(label)}{dashed(label)}")
    return drawing


def steps(values: Floats) -> list[tuple[float, float]]:
    """Return the distribution as at most `MAX_DOTS` points."""
    found = np.sort(values[np.isfinite(values)])
    if not len(found):
        return []
    shares = np.linspace(0.0, 1.0, min(MAX_DOTS, len(found) + 1))
    return list(zip(np.quantile(found, shares).tolist(), shares.tolist(), strict=True))


def _legend(drawing: SvgDrawing, labels: Sequence[str], left: float) -> None:
    x = left
    for label in labels:
        drawing.line((x, 9), (x + 20, 9), f"way l-{colour(label)}{dashed(label)}")
        drawing.text((x + 25, 13), label, "small")
        x += 44 + 6.2 * len(label)


def _frame(
    drawing: SvgDrawing,
    corner: tuple[float, float],
    high: float,
    title: str,
    x_title: str,
    ends: tuple[float, float],
    first: bool,
) -> None:
    left, top = corner
    drawing.text((left, top - 8), title, "head")
    for percent in (0, 25, 50, 75, 100):
        y = top + high * (1 - percent / 100)
        drawing.line((left, y), (left + PANEL, y), "grid")
        if first:
            drawing.text((left - 6, y + 3.5), f"{percent} %", "small", "end")
    for tick in _ticks(ends):
        x = left + PANEL * _along(tick, ends)
        drawing.line((x, top), (x, top + high), "grid")
        drawing.text((x, top + high + 13), f"{tick:g}", "small", "middle")
    drawing.text((left + PANEL / 2, top + high + 28), x_title, "small", "middle")


def _ticks(ends: tuple[float, float]) -> list[float]:
    found = [
        factor * 10.0**power
        for power in range(floor(log10(ends[0])), floor(log10(ends[1])) + 1)
        for factor in ((1.0,) if ends[1] / ends[0] > 500.0 else (1.0, 2.0, 5.0))
    ]
    return [round(tick, 6) for tick in found if ends[0] * 0.999 <= tick <= ends[1] * 1.001]


def _along(value: float, ends: tuple[float, float]) -> float:
    """Return the position on the axis from 0 to 1; values beyond an end are drawn at it."""
    low, high = ends
    held = min(max(value, low), high) if isfinite(value) else high
    return (log10(held) - log10(low)) / (log10(high) - log10(low))
