"""Hooks of MkDocs, named in mkdocs.yml: generated tables, pictures, and diagrams as SVG.

The diagrams of the pages are drawn here, so that the site needs no script from another host. Two
languages are read. `diagram` places boxes on a grid:

    title: What it shows
    box NAME "heading" "text" at COLUMN ROW
    arrow FROM TO "label"

`mermaid` is the state diagram of that tool, as far as `checks.model` writes it. One with
many transitions becomes a table, because its labels would cover each other.
"""

import re
import shlex
from collections.abc import Iterator, Sequence
from html import escape
from math import cos, hypot, pi, sin
from pathlib import Path
from textwrap import wrap
from typing import Any, Final, NamedTuple

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from checks.site.reference import GENERATORS

ROOT: Final = Path(__file__).resolve().parents[2]
FINDINGS: Final = ROOT / "study" / "falsify" / "worlds"
GENERATED: Final = re.compile(r"^<!-- generated: (?P<name>[a-z-]+) -->$", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pictures of the findings, which tests keep up to date."""
    for path in sorted(FINDINGS.glob("*/*.svg")):
        name = f"pictures/findings/{path.parent.name}/{path.name}"
        files.append(File.generated(config, name, content=path.read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Replace the comments that ask for a generated table."""
    return GENERATED.sub(lambda found: GENERATORS[found["name"]](), markdown)


MAX_DRAWN: Final = 13
"""Transitions; more are shown as a table."""
BOX: Final = (200.0, 74.0)
STATE: Final = (150.0, 34.0)
STEP: Final = (360.0, 190.0)
MARGIN: Final = 12.0
CHARACTERS: Final = 30
LABEL_PX: Final = 140.0
"""A label is not wider."""
BEND: Final = 0.14
"""Of the length of an arrow, sideways, where another one leads back."""
START: Final = "[*]"
Point = tuple[float, float]


class Box(NamedTuple):
    """A box by its centre."""

    heading: str
    text: str
    at: Point
    size: Point


class Arrow(NamedTuple):
    """An arrow between two boxes."""

    start: str
    end: str
    label: str


def fence(source: str, language: str, css_class: str, options: Any, md: Any, **_: Any) -> str:
    """Return the HTML of a fenced block, as pymdownx.superfences asks for it."""
    return state_diagram(source) if language == "mermaid" else box_diagram(source)


def box_diagram(source: str) -> str:
    """Draw boxes on a grid and the arrows between them."""
    boxes: dict[str, Box] = {}
    arrows, title = [], ""
    for line in filter(None, map(str.strip, source.splitlines())):
        if line.startswith("title:"):
            title = line.partition(":")[2].strip()
            continue
        kind, *words = shlex.split(line)
        if kind == "box":
            name, heading, text, _, column, row = words
            at = (float(column) * STEP[0], float(row) * STEP[1])
            boxes[name] = Box(heading, text, at, BOX)
        elif kind == "arrow":
            arrows.append(Arrow(*words))
        else:
            raise ValueError(f"diagram: unknown word {kind!r}: use title:, box or arrow")
    return svg(boxes, arrows, title)


def state_diagram(source: str) -> str:
    """Draw a state diagram in a circle, or show it as a table if it has many transitions."""
    first, arrows = "", []
    for line in source.splitlines():
        start, found, rest = line.strip().partition(" --> ")
        end, _, label = rest.partition(": ")
        if start == START:
            first = end
        elif found:
            arrows.append(Arrow(start, end, label))
    names = list(dict.fromkeys(name for arrow in arrows for name in arrow[:2]))
    if len(arrows) > MAX_DRAWN:
        return transition_table(names, arrows, first)
    return svg(around(names), arrows, f"States; the first one is {first}")


def around(names: Sequence[str]) -> dict[str, Box]:
    """Place boxes in an ellipse, the first one at the left."""
    turn = 2 * pi / len(names)
    return {
        name: Box(name, "", (300 - 300 * cos(turn * i), 190 - 190 * sin(turn * i)), STATE)
        for i, name in enumerate(names)
    }


def transition_table(names: Sequence[str], arrows: Sequence[Arrow], first: str) -> str:
    """Return the transitions as a table: a row for each state, a column for each next state."""
    labels = {(arrow.start, arrow.end): arrow.label for arrow in arrows}
    head = "".join(f"<th>to {escape(name)}</th>" for name in names)
    rows = "".join(
        f"<tr><th>{escape(start)}</th>"
        + "".join(f"<td>{escape(labels.get((start, end), ''))}</td>" for end in names)
        + "</tr>"
        for start in names
    )
    caption = f"<p>The first state is {escape(first)}.</p>"
    return (
        f"{caption}<table><thead><tr><th>from</th>{head}</tr></thead><tbody>{rows}</tbody></table>"
    )


def svg(boxes: dict[str, Box], arrows: Sequence[Arrow], title: str) -> str:
    """Return an inline picture; its colours are those of the page, light or dark."""
    xs = [box.at[0] + side * box.size[0] / 2 for box in boxes.values() for side in (-1, 1)]
    ys = [box.at[1] + side * box.size[1] / 2 for box in boxes.values() for side in (-1, 1)]
    pairs = {(arrow.start, arrow.end) for arrow in arrows}
    for arrow in arrows:
        x, _ = middle_of(arrow, boxes, (arrow.end, arrow.start) in pairs)
        xs += [x - LABEL_PX / 2, x + LABEL_PX / 2]
    left, top = min(xs) - MARGIN, min(ys) - MARGIN - 24
    width, height = max(xs) - left + MARGIN, max(ys) - top + MARGIN + 24
    parts = [
        f'<svg class="diagram" role="img" viewBox="{left:.0f} {top:.0f} {width:.0f} {height:.0f}">',
        f"<title>{escape(title)}</title>",
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" '
        'markerHeight="8" orient="auto-start-reverse"><path d="M0 1L10 5L0 9z"/></marker></defs>',
    ]
    drawn = [line for a in arrows for line in arrow_parts(a, boxes, (a.end, a.start) in pairs)]
    parts += [part for part in drawn if part.startswith("<path")]
    parts += [part for box in boxes.values() for part in box_parts(box)]
    parts += [part for part in drawn if part.startswith("<text")]
    return "".join([*parts, "</svg>"])


def box_parts(box: Box) -> Iterator[str]:
    """Yield the elements of a box."""
    (x, y), (width, height) = box.at, box.size
    yield (
        f'<rect x="{x - width / 2:.1f}" y="{y - height / 2:.1f}" width="{width:.0f}" '
        f'height="{height:.0f}" rx="6"/>'
    )
    lines = wrap(box.text, CHARACTERS)
    top = y + 4 - 8 * len(lines)
    yield f'<text class="heading" x="{x:.1f}" y="{top:.1f}">{escape(box.heading)}</text>'
    for number, line in enumerate(lines, 1):
        yield f'<text x="{x:.1f}" y="{top + 16 * number:.1f}">{escape(line)}</text>'


def middle_of(arrow: Arrow, boxes: dict[str, Box], is_double: bool) -> Point:
    """Return the middle of the curve of an arrow, where its label is."""
    (x1, y1), (x2, y2) = boxes[arrow.start].at, boxes[arrow.end].at
    dx, dy = x2 - x1, y2 - y1
    # Labels are wider than high, so arrows above each other need more room.
    bend = (BEND if abs(dx) > STATE[0] else 3 * BEND) if is_double else 0.0
    return (x1 + x2) / 2 + bend * dy, (y1 + y2) / 2 - bend * dx


def arrow_parts(arrow: Arrow, boxes: dict[str, Box], is_double: bool) -> Iterator[str]:
    """Yield the curve and the label of an arrow."""
    first, last = boxes[arrow.start], boxes[arrow.end]
    dx, dy = last.at[0] - first.at[0], last.at[1] - first.at[1]
    middle = middle_of(arrow, boxes, is_double)
    start, end = edge(first, middle), edge(last, middle)
    # The control point of the curve lies twice as far out as its middle.
    control = tuple(2 * m - (s + e) / 2 for m, s, e in zip(middle, start, end, strict=True))
    yield (
        f'<path d="M{start[0]:.1f} {start[1]:.1f}Q{control[0]:.1f} {control[1]:.1f} '
        f'{end[0]:.1f} {end[1]:.1f}" marker-end="url(#tip)"/>'
    )
    lines = wrap(arrow.label, 18 if abs(dx) > abs(dy) else 22)
    for number, line in enumerate(lines):
        y = middle[1] + 15 * (number - (len(lines) - 1) / 2) + 4
        yield f'<text class="label" x="{middle[0]:.1f}" y="{y:.1f}">{escape(line)}</text>'


def edge(box: Box, towards: Point) -> Point:
    """Return the point where the line from the centre of a box to another point leaves the box."""
    dx, dy = towards[0] - box.at[0], towards[1] - box.at[1]
    length = hypot(dx, dy) or 1.0
    reach = min(
        box.size[0] / 2 / abs(dx / length) if dx else length,
        box.size[1] / 2 / abs(dy / length) if dy else length,
    )
    reach += 2.0
    return box.at[0] + dx / length * reach, box.at[1] + dy / length * reach
