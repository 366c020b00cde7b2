"""A small SVG writer: shapes have class names, so that a style sheet sets light and dark.

Numbers are rounded and nothing depends on time, so that equal drawings are equal bytes.
"""

from collections.abc import Iterable
from html import escape
from typing import TypeAlias

from study.report.charts.style import DRAWING_STYLE

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
