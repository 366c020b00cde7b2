"""Draws the pictures of the documentation: `make pictures`.

For some worlds the ways of all navigators beside each other, and the proof of `unreachable`, in
light and in dark; and one drive that moves. Trials are deterministic, so equal code gives equal
pictures.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeAlias

from checks.site import proof_picture
from plant.world.file import load
from protocol.world import World
from study.report.charts.charts import DARK, DRAWING_RULES, LIGHT
from study.report.charts.world_map import WorldMap, simplified
from study.report.drives import DrivenTrial, drive_all
from study.trial.trial import Trial

ROOT: Final = Path(__file__).resolve().parents[2]
FOLDER: Final = ROOT / "docs" / "pictures"
WORLDS: Final = {"u_trap": "u_trap", "spiral": "plant/corpus/fixed/spiral_1_000.toml"}
NAVIGATORS: Final = ("bug", "vgm", "bug1", "bug2", "distbug", "vgm_memory")
PANEL_PX: Final = 300.0
HEAD_PX: Final = 34.0
COLUMNS: Final = 3
THEMES: Final = {"light": LIGHT, "dark": DARK}
SECONDS: Final = 12
"""Of the moving drive, once round."""
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


def moving(world: World, drive: DrivenTrial) -> str:
    """Return a picture in which a disc moves along the way of a drive."""
    found = WorldMap(world, 2 * PANEL_PX, f"A drive in the world {world.name}")
    found.add(drive)
    found.ends()
    way = "L".join("{:.1f} {:.1f}".format(*found.at(point)) for point in simplified(drive.true))
    robot = (
        '<circle class="f-vgm_memory mark" r="9"><animateMotion '
        f'dur="{SECONDS}s" repeatCount="indefinite" path="M{way}"/></circle>'
    )
    return found.drawing.alone().replace("</svg>", f"{robot}\n</svg>")


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
    maps = proof_picture.rings(PANEL_PX)
    for theme in THEMES:
        text = beside(proof_picture.TITLE, maps, theme, proof_picture.RULES)
        (FOLDER / f"{PROOF}-{theme}.svg").write_text(text, encoding="utf-8")
    world = load("u_trap")
    (drive,) = drive_all([Trial(world=world, navigator="vgm_memory", noise="none")], jobs=1)
    (FOLDER / "drive.svg").write_text(moving(world, drive), encoding="utf-8")
    print(f"{FOLDER}: {2 * len(WORLDS) + 3} pictures")
    return 0


if __name__ == "__main__":
    sys.exit(main())
