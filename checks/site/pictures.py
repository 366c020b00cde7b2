"""Draw the pictures of the documentation: `make pictures`.

For some worlds the ways of all navigators beside each other, and the proof of `unreachable`, in
light and in dark. Trials are deterministic, so equal code gives equal pictures. `checks.site.film`
draws the screens of real drives.

The proof has rings of walls around a goal, and the robot's chains of echoes. The chains are those
of the recorded decisions of a trial, in the robot's estimated frame.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias

from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.world import GoalPose, Point, Polyline, Start, World
from robot.core.navigators import proof as proofs
from robot.core.navigators.proof import LEAD, TAIL
from robot.core.navigators.vgm_following import VgmMemory
from robot.core.values import EVERY, Outputs
from study.report.charts import DARK, DRAWING_RULES, LIGHT, SvgDrawing
from study.report.drives import DrivenTrial, drive_all, drive_trial
from study.report.world_map import WorldMap, end_mark, simplified
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

Arc: TypeAlias = tuple[Point, Point]
"""Both ends of the arc on which an echo lies, in metres."""

RULES: Final = (
    ".drawing .chain{stroke:var(--bug1);stroke-width:2;stroke-linecap:round}"
    ".drawing .gap{stroke:var(--bad);stroke-width:2.4;stroke-linecap:round}"
    ".drawing .at{fill:var(--bug);stroke:var(--paper)}"
    ".drawing .room{fill:none;stroke:var(--soft);stroke-dasharray:2 2}"
    ".drawing .c-chain{fill:var(--bug1)}.drawing .c-gap{fill:var(--bad)}"
    ".drawing .c-at{fill:var(--bug)}"
)
"""Style of what a map of a world does not have."""
TITLE: Final = "A proof of unreachable, and two rings in which there is none"
ROBOT_M: Final = 0.24
MORE_CM: Final = (None, 3, 6)
"""Width of the gate of each ring beyond that of the robot; None for a ring without a gate."""
THICK_M: Final = 0.04
WEST_M, SOUTH_M, EAST_M, NORTH_M = 1.3, 0.8, 2.9, 2.4
MIDDLE_M: Final = (SOUTH_M + NORTH_M) / 2.0
SPACING_M: Final = 0.06
"""Least distance between the arcs of one end of the chain that are drawn."""
MARK_PX: Final = 4.0


def ring(more_cm: int | None) -> World:
    """Return a world with a ring of walls around the goal, and perhaps a gate in its east."""
    corners = ((EAST_M, NORTH_M), (WEST_M, NORTH_M), (WEST_M, SOUTH_M), (EAST_M, SOUTH_M))
    points: tuple[Point, ...] = (*corners, corners[0])
    if more_cm is not None:
        half_m = (ROBOT_M + THICK_M + 0.01 * more_cm) / 2.0
        points = ((EAST_M, MIDDLE_M + half_m), *corners, (EAST_M, MIDDLE_M - half_m))
    return World(
        name="ring",
        size_m=(3.6, 3.2),
        start=Start(x_m=0.4, y_m=MIDDLE_M),
        goal=GoalPose(x_m=2.1, y_m=MIDDLE_M),
        obstacles=(Polyline(points, THICK_M),),
    )


@dataclass(slots=True)
class ChainRecorder:
    """Record the chain of the first loop: arcs at its ends, marks, and gaps at which it waits.

    `ticks` is the length of the first loop. `room_m` is the largest distance that the uncertain
    position has required between the goal and the path.
    """

    arcs: list[Arc] = field(default_factory=list)
    marks: list[Point] = field(default_factory=list)
    gaps: list[Arc] = field(default_factory=list)
    ticks: int = 0
    room_m: float = 0.0
    _was_valid: bool = False
    _gap: int = proofs.NO_GAP
    _last: dict[int, Point] = field(default_factory=dict)

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Record one tick."""
        memory = onboard.state.memory
        if not isinstance(memory, VgmMemory) or memory.open_loops:
            return
        self.ticks += 1
        if not memory.following:
            return
        proof = memory.proof
        if proof.is_valid and not self._was_valid:
            self.marks.append((0.001 * proof.mark_x_mm, 0.001 * proof.mark_y_mm))
            self._last.clear()
        self._was_valid = proof.is_valid
        if proof.gap == proofs.WAITING and self._gap != proofs.WAITING:
            flank = [i for i in EVERY[:: memory.side] if proof.chain.seen >> i & 1]
            beyond = [middle(arc_of(proof, i)) for i in flank]
            self.gaps += [(middle(arc_of(proof, TAIL)), place) for place in beyond[:1]]
        self._gap = proof.gap
        if proof.is_valid:
            for end in (LEAD, TAIL):
                self._take(proof, end)
            error_m = proofs.SIGMAS * proofs.position_sigma_m(proof.odometry)
            self.room_m = max(self.room_m, proofs.BOUNDARY_M + error_m)

    def _take(self, proof: proofs.Proof, end: int) -> None:
        arc = arc_of(proof, end)
        (x_m, y_m), (last_x_m, last_y_m) = middle(arc), self._last.get(end, (-9.0, -9.0))
        if (x_m - last_x_m) ** 2 + (y_m - last_y_m) ** 2 >= SPACING_M**2:
            self._last[end] = x_m, y_m
            self.arcs.append(arc)


def arc_of(proof: proofs.Proof, end: int) -> Arc:
    """Return an end of the chain."""
    chain = proof.chain
    right = 0.001 * chain.x_mm[end], 0.001 * chain.y_mm[end]
    return right, (0.001 * chain.left_x_mm[end], 0.001 * chain.left_y_mm[end])


def middle(arc: Arc) -> Point:
    """Return the point in the middle of both ends."""
    (x1, y1), (x2, y2) = arc
    return (x1 + x2) / 2.0, (y1 + y2) / 2.0


def rings(width: float) -> list[tuple[str, DrivenTrial, WorldMap]]:
    """Return a head, the drive and the map for each ring; maps are `width` pixels wide."""
    found = []
    for more_cm in MORE_CM:
        head = "no gate" if more_cm is None else f"a gate {more_cm} cm wider than the robot"
        trial = Trial(world=ring(more_cm), navigator="vgm_memory", noise="none")
        seen = ChainRecorder()
        run_trial(trial, seen)
        drive = drive_trial(trial)
        found.append((head, drive, draw_proof(drive, seen, width, head)))
    return found


def draw_proof(drive: DrivenTrial, seen: ChainRecorder, width: float, head: str) -> WorldMap:
    """Return the map of a drive with its chains."""
    found = WorldMap(drive.trial.world, width, f"{head}: {drive.outcome.outcome}")
    drawing, goal = found.drawing, drive.trial.world.goal
    for arc in seen.arcs:
        drawing.line(found.at(arc[0]), found.at(arc[1]), "chain")
    found.add(drive, faint=True)
    first = map(found.at, simplified(drive.true[: seen.ticks]))
    drawing.polyline(first, "way l-vgm_memory")
    end_mark(drawing, found.at(drive.true[-1][:2]), drive.outcome.outcome, "mark f-vgm_memory")
    for gap in seen.gaps:
        drawing.line(found.at(gap[0]), found.at(gap[1]), "gap")
        x, y = found.at(middle(gap))
        drawing.text((x - 8.0, y + 30.0), "chain waits", "small c-gap", "end")
    found.ends()
    centre = found.at((goal.x_m, goal.y_m))
    edge = found.at((goal.x_m + seen.room_m, goal.y_m))
    drawing.circle(centre, edge[0] - centre[0], "room")
    drawing.text((centre[0], centre[1] - (edge[0] - centre[0]) - 4.0), "room", "small", "middle")
    x, y = found.at(seen.marks[0])
    drawing.rectangle((x - MARK_PX, y - MARK_PX), 2.0 * MARK_PX, 2.0 * MARK_PX, "at")
    drawing.text((x - 8.0, y + 4.0), "mark", "small c-at", "end")
    return found


ROOT: Final = Path(__file__).resolve().parents[2]
FOLDER: Final = ROOT / "docs" / "pictures"
WORLDS: Final = {"u_trap": "u_trap", "spiral": "plant/corpus/fixed/spiral_1_000.toml"}
NAVIGATORS: Final = ("bug", "vgm", "bug1", "bug2", "distbug", "vgm_memory")
PANEL_PX: Final = 300.0
HEAD_PX: Final = 34.0
COLUMNS: Final = 3
THEMES: Final = {"light": LIGHT, "dark": DARK}
PROOF: Final = "proof"
Panel: TypeAlias = tuple[str, DrivenTrial, WorldMap]
"""Head, drive and map."""


def panels(world: World, drives: Sequence[DrivenTrial], theme: str) -> str:
    """Return one picture with a map for each drive, in the colours of a theme."""
    maps = [(drive.trial.navigator, drive, drawn(world, drive)) for drive in drives]
    return beside(f"The ways of the navigators in the world {world.name}", maps, theme)


def beside(title: str, maps: Sequence[Panel], theme: str, rules: str = "") -> str:
    """Return maps beside each other, each below its head and how its drive ended.

    `rules` are added to the style.
    """
    width, height = maps[0][2].drawing.width, maps[0][2].drawing.height + HEAD_PX
    rows = -(-len(maps) // COLUMNS)
    box = f"0 0 {COLUMNS * width:.0f} {rows * height:.0f}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" viewBox="{box}">',
        f"<title>{title}</title>",
        f"<style>:root{{{THEMES[theme]}}}{DRAWING_RULES}{rules}</style>",
        '<rect class="ground" width="100%" height="100%"/>',
    ]
    for number, (head, drive, one) in enumerate(maps):
        x, y = number % COLUMNS * width, number // COLUMNS * height
        parts.append(
            f'<text class="head" x="{x + 8:.0f}" y="{y + 16:.0f}">{head}</text>'
            f'<text class="label" x="{x + 8:.0f}" y="{y + 30:.0f}">{caption(drive)}</text>'
        )
        place = f'x="{x:.1f}" y="{y + HEAD_PX:.1f}" height="{one.drawing.height:.1f}"'
        parts.append(one.drawing.inline().replace("<svg", f"<svg {place}", 1))
    return "\n".join([*parts, "</svg>\n"])


def drawn(world: World, drive: DrivenTrial) -> WorldMap:
    """Return the map of a world with one drive."""
    found = WorldMap(world, PANEL_PX, f"{drive.trial.navigator}: {caption(drive)}")
    found.add(drive)
    found.ends()
    return found


def caption(drive: DrivenTrial) -> str:
    """Return how a drive ended, in a few words."""
    outcome = drive.outcome
    return f"{outcome.outcome} after {outcome.time_s:.0f} s, {outcome.path_m:.1f} m"


def estimated() -> str:
    """Return the map of a drive with its true path, the estimated one and its ellipse."""
    drive = drive_trial(Trial(world=load("u_trap"), noise="harsh"))
    found = WorldMap(drive.trial.world, 2.0 * PANEL_PX, "The true path and the estimated one")
    found.add(drive, belief=True)
    found.ends()
    return found.drawing.alone()


CYCLE_PX: Final = 60.0
ROW_PX: Final = 44.0
LATE: Final = 3
"""Number of the cycle that is late, from 0."""
CLOCKS: Final = (
    ("on time", (0, 1, 2, 3, 4, 5, 6), 0.3, "a cycle every 50 ms"),
    ("paced, busy", (0, 1, 2, 3, 4.6, 5.6, 6.6), 1.5, "simulated time waits, and nothing changes"),
    ("wall, busy", (0, 1, 2, 3), 1.5, "BUDGET: the robot stops"),
)
"""Name, starts of the cycles in periods of wall time, length of the late one, and what follows."""


def clocks() -> str:
    """Return what a late cycle does with each clock."""
    left, right = 100.0, 100.0 + 8.0 * CYCLE_PX
    drawing = SvgDrawing(right + 280.0, len(CLOCKS) * ROW_PX + 20.0, "A late cycle on each clock")
    for number, (name, starts, late, follows) in enumerate(CLOCKS):
        y = 30.0 + number * ROW_PX
        drawing.text((8.0, y + 4.0), name)
        drawing.line((left, y + 9.0), (right, y + 9.0), "axis")
        for cycle, start in enumerate(starts):
            share = late if cycle == LATE else 0.3
            kind = "f-bug" if share > 1.0 else "f-vgm_memory"
            drawing.rectangle((left + start * CYCLE_PX, y - 9.0), share * CYCLE_PX, 18.0, kind)
        drawing.text((right + 10.0, y + 4.0), follows)
    return drawing.alone()


def in_theme(picture: str, theme: str) -> str:
    """Return a picture in the colours of one theme, whatever the reader's system prefers."""
    start, end = picture.index("<style>"), picture.index("</style>")
    rules = f"<style>:root{{{THEMES[theme]}}}{DRAWING_RULES}"
    return picture[:start] + rules + picture[end:]


ALONE: Final = {"odometry": estimated, "clocks": clocks}


def main() -> int:
    """Write all pictures into docs/pictures."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, file in WORLDS.items():
        world = load(str(ROOT / file) if "/" in file else file)
        trials = [Trial(world=world, navigator=one, noise="none") for one in NAVIGATORS]
        drives = drive_all(trials, jobs=1)
        for theme in THEMES:
            path = FOLDER / f"navigators-{name}-{theme}.svg"
            path.write_text(panels(world, drives, theme), encoding="utf-8")
    maps = rings(PANEL_PX)
    for theme in THEMES:
        text = beside(TITLE, maps, theme, RULES)
        (FOLDER / f"{PROOF}-{theme}.svg").write_text(text, encoding="utf-8")
    for name, draw in ALONE.items():
        picture = draw()
        for theme in THEMES:
            path = FOLDER / f"{name}-{theme}.svg"
            path.write_text(in_theme(picture, theme), encoding="utf-8")
    print(f"{FOLDER}: {2 * (len(WORLDS) + 1 + len(ALONE))} pictures")
    return 0


if __name__ == "__main__":
    sys.exit(main())
