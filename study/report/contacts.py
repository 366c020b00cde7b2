"""`python -m study.report.contacts STUDY`: explain the contacts by own motion, one by one.

Each is driven again, and drawn with the last seconds before it, about a metre and a half wide.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from functools import partial
from math import cos, degrees, sin
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa

from plant.corpus import ADVERSARIAL_FAMILIES
from plant.model.configuration import body_of
from plant.model.geometry import clearance_m
from protocol.wire.enums import Branch
from protocol.wire.reasons import reason_text
from protocol.world import Point, World, WorldCircle, WorldPolygon
from runtime.units import MM_PER_M
from study.report.charts import Dot, SvgDrawing, colour
from study.report.contact_kinds import (
    BLOCK,
    RULES,
    PlaceRecord,
    Touched,
    TracedTick,
    before_contact,
    kind_of,
    knowledge_of,
    seen_from,
    touched,
    world_at,
)
from study.report.gallery import WorldOf, command_of
from study.report.page import DASH, PageTable, number, table_lines
from study.report.targets import OWN
from study.report.world_map import simplified, wall_parts
from study.runner.plan import world_of
from study.runner.rows import TrialRow
from study.runner.run_task import trial_of
from study.runner.store import read, rows_of

WIDTH: Final = 300.0
WIDE_M: Final = 1.5
BAR_M: Final = 0.1
SCALE: Final = WIDTH / WIDE_M
CROSS: Final = 5.0
POINT: Final = 1.8
RIM: Final = 10.0


class CloseUp:
    """A square of the world around the robot at the contact; metres to pixels, y upwards."""

    def __init__(self, centre: Point, title: str) -> None:
        self._left, self._top = centre[0] - WIDE_M / 2.0, centre[1] + WIDE_M / 2.0
        self._centre = centre
        self.drawing = SvgDrawing(WIDTH, WIDTH, title)

    def at(self, point: Point) -> Dot:
        """Return the pixel of a point in metres."""
        return (point[0] - self._left) * SCALE, (self._top - point[1]) * SCALE

    def ground(self, world: World) -> None:
        """Draw the floor and the obstacles that reach into the square."""
        width_m, height_m = world.size_m
        kind = "rim" if world.walls else "ground"
        self.drawing.rectangle(self.at((0.0, height_m)), width_m * SCALE, height_m * SCALE, kind)
        for obstacle in world.obstacles:
            if clearance_m(self._centre, obstacle) > WIDE_M:
                continue
            if isinstance(obstacle, WorldCircle):
                kind = "mover" if obstacle.path_m else "solid"
                centre = self.at((obstacle.x_m, obstacle.y_m))
                self.drawing.circle(centre, obstacle.radius_m * SCALE, kind)
            elif isinstance(obstacle, WorldPolygon):
                self.drawing.polygon(map(self.at, obstacle.points_m), "solid")
            else:
                half = max(0.5, obstacle.thickness_m * SCALE / 2.0)
                wall_parts(self.drawing, [self.at(point) for point in obstacle.points_m], half)

    def robot(self, end: TracedTick, radius_m: float) -> None:
        """Draw the robot at the contact, with its heading."""
        x_m, y_m, heading_rad = end.true
        tip = x_m + radius_m * cos(heading_rad), y_m + radius_m * sin(heading_rad)
        self.drawing.circle(self.at((x_m, y_m)), radius_m * SCALE, "goal")
        self.drawing.line(self.at((x_m, y_m)), self.at(tip), "goal")

    def memory(self, tick: TracedTick) -> None:
        """Draw the stored points where the robot estimated them, seen from its true pose."""
        x_m, y_m, heading_rad = tick.true
        for point in tick.points:
            ahead, left = seen_from(tick.estimated, (point.x_m, point.y_m))
            true = (
                x_m + ahead * cos(heading_rad) - left * sin(heading_rad),
                y_m + ahead * sin(heading_rad) + left * cos(heading_rad),
            )
            self.drawing.circle(self.at(true), POINT, "start" if point.counts else "doubt")

    def cross(self, place: Point) -> None:
        """Mark the touched place, and draw a bar of ten centimetres in a corner."""
        x, y = self.at(place)
        self.drawing.line((x - CROSS, y - CROSS), (x + CROSS, y + CROSS), "cross")
        self.drawing.line((x - CROSS, y + CROSS), (x + CROSS, y - CROSS), "cross")
        low = WIDTH - RIM
        self.drawing.line((RIM, low), (RIM + BAR_M * SCALE, low), "axis")
        self.drawing.text((RIM + BAR_M * SCALE + 5.0, low + 3.5), "0.1 m", "small")


def close_up(
    world: World, ticks: Sequence[TracedTick], place: Touched, radius_m: float, title: str
) -> SvgDrawing:
    """Draw the surroundings, the true way of the kept ticks, the memory and the touched place."""
    end = ticks[-1]
    plan = CloseUp(end.true[:2], title)
    plan.ground(world_at(world, end.time_s))
    way = [plan.at(point) for point in simplified([tick.true for tick in ticks])]
    plan.drawing.polyline(way, f"way l-{colour('vgm_memory')}")
    plan.memory(ticks[-2] if len(ticks) > 1 else end)
    plan.robot(end, radius_m)
    plan.cross(place.point)
    return plan.drawing


NOISES: Final = ("default", "lossy")
HASTY: Final = "crowd_hasty"
"""People faster than the robot can avoid; their contacts are not explained one by one."""

SHOWN_S: Final = 5.0
"""Seconds before the contact whose decisions are listed."""

MOST_EVENTS: Final = 8
EDGES: Final = ("its end", "a corner")


class ExplainedContact(NamedTuple):
    """A contact with its kind and records; `same`: the drive is the recorded one."""

    row: TrialRow
    kind: str
    place: Touched
    known: PlaceRecord
    ticks: Sequence[TracedTick]
    drawing: SvgDrawing
    same: bool


def chosen_rows(table: pa.Table) -> list[TrialRow]:
    """Return the rows to explain: contacts of the own navigator by its own motion.

    Left out are other noise levels, adversarial worlds and people faster than 0.2 m/s.
    """
    rows = [
        row
        for row in rows_of(table)
        if row.own_contacts
        and row.navigator == OWN
        and row.noise in NOISES
        and row.family not in (*ADVERSARIAL_FAMILIES, HASTY)
    ]
    return sorted(rows, key=lambda row: (NOISES.index(row.noise), row.family, row.trial_id))


def explained(row: TrialRow, world: World) -> ExplainedContact:
    """Drive a trial again, and find the touched place and the kind of the contact."""
    trial, radius_m = trial_of(row, world), body_of(world).radius_m
    ticks, outcome = before_contact(trial)
    end, last = ticks[-1], ticks[-2] if len(ticks) > 1 else ticks[-1]
    place = touched(world, end.true[:2], end.time_s)
    known = knowledge_of(ticks, place, radius_m)
    kind = kind_of(place, known, last.branch)
    title = f"Contact in {row.world}, noise {row.noise}, seed {row.seed}: {kind}"
    drawing = close_up(world, ticks, place, radius_m, title)
    return ExplainedContact(row, kind, place, known, ticks, drawing, outcome.digest == row.digest)


def explain_all(table: pa.Table, world_of: WorldOf) -> list[ExplainedContact]:
    """Explain every chosen row; raise UserError or WorldError where its world is missing."""
    return [explained(row, world_of(row.world_source)) for row in chosen_rows(table)]


def file_of(one: ExplainedContact) -> str:
    """Return the name of the drawing's file."""
    return f"{one.row.trial_id[:12]}.svg"


def page_of(found: Sequence[ExplainedContact], table: pa.Table, folder: str) -> str:
    """Return the page as Markdown; `folder` holds the drawings, relative to the page."""
    parts = [HEAD, _counts(found, table), kinds_table(found)]
    parts += [_section(one, folder) for one in found]
    return "\n\n".join(parts) + "\n"


HEAD: Final = f"""\
<!-- Generated by `python -m study.report.contacts`. -->

# Contacts by own motion

Each trial of the [study](study/report.md) in which `{OWN}` touched something by its own motion,
with `default` and `lossy` noise: in the corpus, among thin walls, in generated grid maps and among
people up to 0.2 m/s. Every trial was driven again to record the seconds before its contact. The
kind follows from a rule. [Thin walls and corners](../concepts/navigators.md#thin-walls-and-corners)
describes the rules against them.

In the drawings the line is the true path of the last ten seconds, the ring is the robot at the
contact, and the cross is the touched place. Dots are stored points that the navigator keeps clear
of. Circles are stored points that do not count yet. Both are drawn as seen from the true pose. The
bar is 0.1 m long. A range is measured from the rim of the robot."""


def _counts(found: Sequence[ExplainedContact], table: pa.Table) -> str:
    driven: Counter[tuple[str, str]] = Counter()
    columns = (table.column(name).to_pylist() for name in ("navigator", "noise", "family"))
    for navigator, noise, family in zip(*columns, strict=True):
        if navigator == OWN:
            driven[noise, family] += 1
    touched_in = Counter((one.row.noise, one.row.family) for one in found)
    rows = tuple(
        (noise, family, f"{driven[noise, family]:,}", str(count))
        for (noise, family), count in touched_in.items()
    )
    head = ("noise", "family", "trials", "contacts by own motion")
    commits = ", ".join(
        sorted({commit[:12] for commit in table.column("commit").to_pylist() if commit})
    )
    made = (
        f"{len(found)} trials, driven with commit {commits or DASH}. Families without such a "
        "contact are left out."
    )
    return f"{made}\n\n{table_lines(PageTable('', head, rows, names=2))}"


def kinds_table(found: Sequence[ExplainedContact]) -> str:
    """Return the table of the kinds, each with its rule and its counts by noise."""
    rows = []
    for kind, rule in RULES.items():
        some = [one.row for one in found if one.kind == kind]
        counts = Counter(row.noise for row in some)
        worlds = len({row.world_digest for row in some})
        rows.append((kind, rule, *(str(counts[noise]) for noise in NOISES), str(worlds)))
    head = ("kind", "rule, the first that applies", *NOISES, "worlds")
    table = PageTable("", head, tuple(rows), names=2)
    return f"## Kinds\n\n{STORED}\n\n{table_lines(table)}"


STORED: Final = (
    "A place is *stored* while a point of the memory that counts is within 10 cm of it. An edge is "
    "the end of a wall or the corner of a block. Several contacts in one world are often the same "
    "edge, so the worlds are counted, too."
)


def _section(one: ExplainedContact, folder: str) -> str:
    row, title = one.row, f"{one.row.world}, {one.row.noise}, seed {one.row.seed}"
    lines = [
        f"## {title}",
        f"![{one.drawing.title}]({folder}/{file_of(one)})",
        f"**{one.kind[0].upper()}{one.kind[1:]}.** Trial `{row.trial_id[:12]}`, after "
        f"{row.time_s:.2f} s and {row.path_m:.1f} m.",
        "\n".join(f"- {fact}" for fact in facts_of(one)),
        "Decisions before the contact: " + "; ".join(events_of(one.ticks)) + ".",
        f"```sh\n{command_of(row)}\n```",
    ]
    if not one.same:
        lines.insert(3, "**This is not the recorded drive**: the code differs.")
    return "\n\n".join(lines)


def facts_of(one: ExplainedContact) -> list[str]:
    """Return the touched place and the measurements as short sentences."""
    known, ticks = one.known, one.ticks
    last = ticks[-2] if len(ticks) > 1 else ticks[-1]
    edge = f" at {EDGES[one.place.name == BLOCK]}" if one.place.is_edge else ""
    side = "left" if known.bearing_rad > 0.0 else "right"
    stored = "no stored point within 10 cm of the place"
    if known.stored_m is not None and known.aside_m is not None:
        stored = (
            f"nearest stored point at a range of {round(MM_PER_M * known.stored_m)} mm, "
            f"{round(MM_PER_M * known.aside_m)} mm from the place"
        )
    elif known.last_s is not None:
        stored += f"; the last one {number(known.last_s)} s before"
    echo = "no echo from there in the last ten seconds"
    if known.echo_s is not None and known.echo_m is not None:
        echo = (
            f"last echo from there {number(known.echo_s)} s before, at a range of "
            f"{round(MM_PER_M * known.echo_m)} mm"
        )
    return [
        f"Touched: {one.place.name}{edge}, {abs(known.bearing_deg):.0f}° to the {side} of the "
        "heading.",
        f"Commanded in the tick before: {number(last.speed_m_s)} m/s, "
        f"{round(degrees(last.yaw_rate_rad_s))}°/s.",
        f"Live: {echo}.",
        f"Memory: {stored}.",
    ]


def events_of(ticks: Sequence[TracedTick]) -> list[str]:
    """Return the changes of decision and guard in the last seconds, with their times."""
    end_s, events, before = ticks[-1].time_s, [], None
    for tick in ticks[:-1]:
        state = tick.branch, tick.guard
        if end_s - tick.time_s <= SHOWN_S and state != before:
            words = Branch(tick.branch).name.lower().replace("_", " ")
            if tick.guard:
                words += f" ({reason_text(tick.guard)})"
            events.append(f"from {end_s - tick.time_s:.2f} s before, {words}")
            before = state
    left_out = len(events) - MOST_EVENTS
    return [f"{left_out} more", *events[left_out:]] if left_out > 0 else events or ["none"]


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page and its drawings, and remove drawings of earlier pages."""
    options = parser().parse_args(argv)
    table = read(options.study)
    found = explain_all(table, partial(world_of, directory=options.study))
    folder: Path = options.page.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.svg"):
        old.unlink()
    for one in found:
        (folder / file_of(one)).write_text(one.drawing.alone(), encoding="utf-8", newline="\n")
    text = page_of(found, table, folder.name)
    options.page.write_text(text, encoding="utf-8", newline="\n")
    print(f"{options.page}: {len(found)} contacts")
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m study.report.contacts", description=__doc__)
    made.add_argument("study", type=Path, metavar="STUDY", help="the study's directory")
    made.add_argument("--page", type=Path, required=True, metavar="FILE", help="page to write")
    return made


if __name__ == "__main__":
    sys.exit(main())
