"""A map of a world with the drives in it.

Drawings of failures, selected to cover many families and kinds of failure.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import atan2, cos, degrees, pi, sin, sqrt
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import pyarrow as pa

from plant.model.configuration import body_of
from plant.model.errors import WorldError
from protocol.outcome import CHI2_2, LOST, UNREACHABLE
from protocol.wire.reasons import Reason
from protocol.world import Point, Polyline, World, WorldCircle, WorldPolygon
from runtime.errors import UserError
from study.intervals import CONFIDENT, Floats
from study.report.charts import Dot, SvgDrawing, colour, dashed
from study.report.drives import DrivenTrial, Pose, attempt_all
from study.report.page import Block, Gallery, PageFigure, PageSection, Paragraph
from study.report.trials import NOISES, Trials
from study.runner.plan import OwnFile
from study.runner.rows import FAILED, TrialRow
from study.runner.run_task import trial_of
from study.runner.store import rows_of
from study.trial.trial import Trial

RIM: Final = 8.0
STRAIGHT_M: Final = 0.004
MARK: Final = 4.5
FOOT: Final = 14.0


class WorldMap:
    """A map of a world; metres to pixels, y upwards."""

    def __init__(self, world: World, width: float, title: str) -> None:
        self.world = world
        width_m, height_m = world.size_m
        self._scale = min((width - 2 * RIM) / width_m, 1.15 * (width - 2 * RIM) / height_m)
        self._top = RIM + height_m * self._scale
        wide = 2 * RIM + width_m * self._scale
        self.drawing = SvgDrawing(wide, self._top + RIM + FOOT, title)
        self._ground()

    def at(self, point: Point) -> Dot:
        """Return the pixel of a point in metres."""
        return RIM + point[0] * self._scale, self._top - point[1] * self._scale

    def add(self, drive: DrivenTrial, belief: bool = False, faint: bool = False) -> None:
        """Draw the true path in the navigator's colour; with `belief` the estimated one dotted."""
        label = f"{drive.trial.navigator}, {drive.trial.side}"
        kind = f"way l-{colour(label)}{dashed(label)}{' faint' if faint else ''}"
        self.drawing.polyline(map(self.at, simplified(drive.true)), kind)
        if belief:
            self.drawing.polyline(map(self.at, simplified(drive.believed)), "believed")
            self._ellipse(drive)
        if not faint:
            self._end(drive, colour(label))

    def ends(self) -> None:
        """Draw start, goal with tolerance and heading, and a bar one metre long."""
        world, body = self.world, body_of(self.world)
        start, goal = self.at((world.start.x_m, world.start.y_m)), world.goal
        self.drawing.circle(start, 3.0, "start")
        self._heading(start, world.start.heading_rad, 4.0, body.radius_m * self._scale)
        centre = self.at((goal.x_m, goal.y_m))
        self.drawing.circle(centre, max(6.5, goal.position_tolerance_m * self._scale), "goal")
        if goal.heading_rad is not None:
            self._heading(centre, goal.heading_rad, 6.5, 13.0)
        y = self._top + RIM + 4.0
        self.drawing.line((RIM, y), (RIM + self._scale, y), "axis")
        self.drawing.text((RIM + self._scale + 5.0, y + 3.5), "1 m", "small")

    def legend(self, labels: Sequence[str]) -> None:
        """Draw the line style of each navigator beside the bar."""
        x, y = RIM + self._scale + 40.0, self._top + RIM + 4.0
        for label in labels:
            self.drawing.line((x, y), (x + 16.0, y), f"way l-{colour(label)}{dashed(label)}")
            self.drawing.text((x + 20.0, y + 3.5), label, "small")
            x += 32.0 + 5.6 * len(label)

    def straight(self) -> None:
        """Draw the straight line from start to goal."""
        start, goal = self.world.start, self.world.goal
        ends = self.at((start.x_m, start.y_m)), self.at((goal.x_m, goal.y_m))
        self.drawing.line(*ends, "straight")

    def _ground(self) -> None:
        width_m, height_m = self.world.size_m
        kind = "rim" if self.world.walls else "ground"
        corner = self.at((0.0, height_m))
        self.drawing.rectangle(corner, width_m * self._scale, height_m * self._scale, kind)
        for obstacle in self.world.obstacles:
            if isinstance(obstacle, WorldPolygon):
                self.drawing.polygon(map(self.at, obstacle.points_m), "solid")
            elif isinstance(obstacle, Polyline):
                self._wall(obstacle)
            else:
                self._disc(obstacle)

    def _wall(self, wall: Polyline) -> None:
        half = max(0.5, wall.thickness_m * self._scale / 2.0)
        wall_parts(self.drawing, [self.at(point) for point in wall.points_m], half)

    def _disc(self, disc: WorldCircle) -> None:
        if disc.path_m:
            self.drawing.polyline(map(self.at, disc.path_m), "moverline")
        kind = "mover" if disc.path_m else "solid"
        self.drawing.circle(self.at((disc.x_m, disc.y_m)), disc.radius_m * self._scale, kind)

    def _heading(self, at: Dot, heading_rad: float, near: float, far: float) -> None:
        dx, dy = cos(heading_rad), -sin(heading_rad)
        ends = (at[0] + near * dx, at[1] + near * dy), (at[0] + far * dx, at[1] + far * dy)
        self.drawing.line(*ends, "goal")

    def _ellipse(self, drive: DrivenTrial) -> None:
        """Draw the confidence ellipse around the last estimated position."""
        long_m, short_m, turn_rad = ellipse(drive.covariance)
        x_m, y_m, _ = drive.believed[-1]
        radii = long_m * self._scale, short_m * self._scale
        self.drawing.ellipse(self.at((x_m, y_m)), radii, -degrees(turn_rad), "doubt")

    def _end(self, drive: DrivenTrial, name: str) -> None:
        x_m, y_m, _ = drive.true[-1]
        end_mark(self.drawing, self.at((x_m, y_m)), drive.outcome.outcome, f"mark f-{name}")


def wall_parts(drawing: SvgDrawing, dots: Sequence[Dot], half: float) -> None:
    """Draw a wall with round ends and joints; `half` is half its width in pixels."""
    for a, b in pairwise(dots):
        drawing.polygon(_bar(a, b, half), "solid")
    for dot in dots:
        drawing.circle(dot, half, "solid")


def end_mark(drawing: SvgDrawing, at: Dot, outcome: str, kind: str) -> None:
    """Draw the mark of an outcome.

    Disc: reached; cross: collided; square: stuck; bar: unreachable; rhombus: lost; triangle:
    others.
    """
    x, y = at
    if outcome == "reached":
        drawing.circle(at, MARK, kind)
    elif outcome == "collided":
        drawing.line((x - MARK, y - MARK), (x + MARK, y + MARK), "cross")
        drawing.line((x - MARK, y + MARK), (x + MARK, y - MARK), "cross")
    elif outcome == "stuck":
        drawing.rectangle((x - MARK, y - MARK), 2 * MARK, 2 * MARK, kind)
    elif outcome == UNREACHABLE:
        drawing.rectangle((x - MARK, y - MARK / 2), 2 * MARK, MARK, kind)
    elif outcome == LOST:
        drawing.polygon(((x, y - MARK), (x + MARK, y), (x, y + MARK), (x - MARK, y)), kind)
    else:
        tip = ((x, y - MARK - 1), (x - MARK, y + MARK - 1), (x + MARK, y + MARK - 1))
        drawing.polygon(tip, kind)


def ellipse(covariance: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return both semi-axes of the confidence ellipse in m, and the direction of the longer."""
    xx, xy, yy = covariance
    middle, half = (xx + yy) / 2.0, sqrt(((xx - yy) / 2.0) ** 2 + xy * xy)
    long_m = sqrt(CHI2_2 * max(0.0, middle + half))
    short_m = sqrt(CHI2_2 * max(0.0, middle - half))
    return long_m, short_m, 0.5 * atan2(2.0 * xy, xx - yy) if half > 0.0 else 0.0


def simplified(poses: Sequence[Pose]) -> list[Point]:
    """Return the path without points that a straight line covers within `STRAIGHT_M`.

    Ramer, Douglas and Peucker's algorithm with a stack instead of recursion.
    """
    points = np.array(poses, dtype=np.float64)[:, :2]
    kept = np.zeros(len(points), dtype=np.bool_)
    kept[[0, -1]] = True
    pending = [(0, len(points) - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        away_m = _away_m(points[first + 1 : last], points[first], points[last])
        worst = int(away_m.argmax())
        if away_m[worst] > STRAIGHT_M:
            middle = first + 1 + worst
            kept[middle] = True
            pending += [(first, middle), (middle, last)]
    return [(x_m, y_m) for x_m, y_m in points[kept].tolist()]


def _away_m(points: Floats, a: Floats, b: Floats) -> Floats:
    """Return the distance of each point from the segment ab."""
    along, off = b - a, points - a
    length2 = float(along @ along)
    share = np.clip(off @ along / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(points))
    away: Floats = np.sqrt(((off - share[:, None] * along) ** 2).sum(axis=1))
    return away


def _bar(a: Dot, b: Dot, half: float) -> tuple[Dot, Dot, Dot, Dot]:
    """Return the corners of a line of width 2 `half`."""
    turn = atan2(b[1] - a[1], b[0] - a[0]) + pi / 2.0
    dx, dy = half * cos(turn), half * sin(turn)
    return (
        (a[0] + dx, a[1] + dy),
        (b[0] + dx, b[1] + dy),
        (b[0] - dx, b[1] - dy),
        (
            a[0] - dx,
            a[1] - dy,
        ),
    )


WorldOf: TypeAlias = Callable[[str], World]
"""Returns the world of a row's `world_source`; raises WorldError, UserError or ValueError."""

PER_NAVIGATOR: Final = 6
WIDTH: Final = 330.0
FIXED_PLACE: Final = "plant/corpus/fixed"


class SelectedFailure(NamedTuple):
    """A selected failure."""

    label: str
    kind: str
    row: TrialRow


def selected_failures(table: pa.Table, trials: Trials, most: int) -> list[SelectedFailure]:
    """Select up to `most` failures of each navigator: frequent kinds first, then new ones.

    The column `place` of `trials` holds the row of the table.
    """
    found: list[SelectedFailure] = []
    for label in trials.labels():
        some = trials.of(label=label)
        failures = some.where(~(some.success | some.has(outcome=FAILED)))
        places = failures.numbers("place").astype(int).tolist()
        rows = rows_of(table.take(places)) if places else []
        found += [SelectedFailure(label, kind_of(row), row) for row in diverse(rows, most)]
    return found


def kind_of(row: TrialRow) -> str:
    """Return the kind of a failure."""
    if row.goal_reason == Reason.UNREACHABLE and row.reachable is not False:
        return "called unreachable"
    if row.outcome == "reached":
        return "hit by an obstacle" if row.contacts else "reached"
    return row.outcome


def diverse(rows: list[TrialRow], most: int) -> list[TrialRow]:
    """Select one row of each kind and family in turn, new kinds and families first."""
    groups: dict[tuple[str, str], list[TrialRow]] = {}
    for row in sorted(rows, key=_order):
        groups.setdefault((kind_of(row), row.family), []).append(row)
    picked: list[TrialRow] = []
    kinds: set[str] = set()
    families: set[str] = set()
    while groups and len(picked) < most:
        best = min(
            groups,
            key=lambda key: (key[0] in kinds, key[1] in families, -len(groups[key]), key),
        )
        picked.append(groups.pop(best)[0])
        kinds.add(best[0])
        families.add(best[1])
    return picked


def _order(row: TrialRow) -> tuple[int, float, str, int]:
    """Return the sort key: least noise first, then the shortest drive, which are easiest to see."""
    noise = NOISES.index(row.noise) if row.noise in NOISES else len(NOISES)
    return noise, row.time_s, row.trial_id, row.seed


def gallery(
    found: list[SelectedFailure],
    world_of: WorldOf,
    jobs: int,
    own: Mapping[str, OwnFile] = MappingProxyType({}),
) -> PageSection:
    """Run the selected failures once more and draw them."""
    figures: dict[str, list[PageFigure]] = {}
    lost: list[str] = []
    for number, (one, drive) in enumerate(
        zip(found, rerun(found, world_of, jobs, own), strict=True)
    ):
        if isinstance(drive, DrivenTrial):
            name = f"failure-{number + 1:02d}"
            figures.setdefault(one.label, []).append(_figure(one, drive, name))
        else:
            lost.append(f"`{one.row.trial_id[:12]}` in {one.row.world}: {drive}")
    parts = tuple(PageSection(label, (Gallery(tuple(some)),)) for label, some in figures.items())
    blocks: tuple[Block, ...] = (
        Paragraph(LEGEND if figures else "No trial failed, or none was selected."),
    )
    if lost:
        blocks += (Paragraph("Could not be run again: " + "; ".join(lost) + "."),)
    return PageSection("Failures", blocks, parts)


def rerun(
    found: list[SelectedFailure], world_of: WorldOf, jobs: int, own: Mapping[str, OwnFile]
) -> list[DrivenTrial | str]:
    """Run each failure again; return an error as text."""
    trials: dict[int, Trial] = {}
    results: dict[int, DrivenTrial | str] = {}
    for index, one in enumerate(found):
        try:
            trials[index] = trial_of(one.row, world_of(one.row.world_source), own)
        except (UserError, WorldError, ValueError) as error:
            results[index] = (str(error).splitlines() or [""])[0]
    results.update(zip(trials, attempt_all(list(trials.values()), jobs), strict=True))
    return [results[index] for index in range(len(found))]


OTHER: Final = "the code differs, or the machine rounds differently"
LEGEND: Final = (
    "Some failures of each navigator, selected by rule: every kind of failure and every family in "
    "turn, the least noise and the shortest drive first. Coloured: the true path; dotted: the "
    f"estimated path, ending in its {CONFIDENT} ellipse; small dot: start; ring: goal, with its "
    "heading if one is required. The path ends in a disc if the goal was reached, a square if the "
    "robot was stuck, a bar if it called the goal unreachable, a rhombus if it was lost, a "
    "triangle after a timeout, a cross after a contact. Moving obstacles are "
    "drawn at their start, with their path."
)


def _figure(one: SelectedFailure, drive: DrivenTrial, name: str) -> PageFigure:
    row, outcome = one.row, drive.outcome
    title = f"{one.label} in {row.world}, noise {row.noise}, seed {row.seed}: {one.kind}"
    plan = WorldMap(drive.trial.world, WIDTH, title)
    plan.straight()
    plan.add(drive, belief=True)
    plan.ends()
    note = f"{row.family}; {row.reason}; {row.time_s:.0f} s, {row.path_m:.1f} m"
    if row.shortest_path_m:
        note += f" of {row.shortest_path_m:.1f} m"
    note += f"; trial `{row.trial_id[:12]}`"
    if outcome.digest != row.digest:
        note += f". **This is not the recorded drive**: {OTHER}"
    caption = f"**{row.world}**, {row.noise}, seed {row.seed}: **{one.kind}**"
    return PageFigure(name, plan.drawing, caption, note, command_of(row, drive.trial.navigator))


def command_of(row: TrialRow, navigator: str = "") -> str:
    """Return the command that repeats the drive, to be run in the project's directory.

    `navigator` is the reference of one of the user's own.
    """
    world, before = _world_file(row.world_source)
    parameters: dict[str, float] = json.loads(row.parameters or "{}")
    words = [
        *("sidestep trial --world", world, "--navigator", navigator or row.navigator),
        *("--side", row.side),
        *("--seed", str(row.seed), "--noise", row.noise, "--timeout", f"{row.timeout_s:g}"),
        *(f"--param {name}={value!r}" for name, value in parameters.items()),
        *(() if row.calibrated else ("--uncalibrated",)),
    ]
    return before + " ".join(words)


def _world_file(source: str) -> tuple[str, str]:
    """Return the world for `sidestep trial`, and commands that must precede it."""
    kind, _, rest = source.partition(":")
    if kind == "corpus":
        family, seed, index = rest.split(":")
        make = f"sidestep worlds generate --family {family} --per-family {int(index) + 1}"
        file = f"worlds/{family}_{seed}_{int(index):03d}.toml"
        return file, f"{make} --seed {seed} --out worlds\n"
    places = {
        "shipped": rest,
        "fixed": f"{FIXED_PLACE}/{rest}.toml",
        "kept": f"STUDY/worlds/{rest}",
    }
    return places.get(kind, source), ""
