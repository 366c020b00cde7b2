"""Pictures of the documentation: whole, small, and without anything from another host."""

import re
from pathlib import Path
from xml.etree import ElementTree

from checks.site.pictures import (
    FOLDER,
    NAVIGATORS,
    PANEL_PX,
    RULES,
    THEMES,
    TITLE,
    WORLDS,
    ChainRecorder,
    beside,
    moving,
    panels,
    ring,
    rings,
)
from plant.world.file import load
from study.report.drives import drive_trial
from study.trial.trial import Trial, run_trial
from tests.support.each import each

PICTURES = sorted(FOLDER.glob("*.svg"))
SVG = "{http://www.w3.org/2000/svg}"


def test_all_pictures_are_committed() -> None:
    names = {f"navigators-{world}-{theme}.svg" for world in WORLDS for theme in THEMES}
    names |= {f"proof-{theme}.svg" for theme in THEMES} | {"drive.svg"}
    assert {path.name for path in PICTURES} == names


@each("path", PICTURES)
def test_picture_is_whole_and_small(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert ElementTree.fromstring(text).tag == f"{SVG}svg"
    assert len(text) < 60_000
    assert set(re.findall(r"https?://[^\"]+", text)) == {"http://www.w3.org/2000/svg"}


def test_a_drive_is_drawn_in_a_panel_and_moving() -> None:
    world = load("open")
    drive = drive_trial(Trial(world=world, navigator=NAVIGATORS[0], noise="none"))
    whole = ElementTree.fromstring(panels(world, [drive], "dark"))
    words = [element.text for element in whole.findall(f"{SVG}text")]
    assert words[0] == NAVIGATORS[0]
    assert (words[1] or "").startswith("reached after ")
    assert (
        next(ElementTree.fromstring(moving(world, drive)).iter(f"{SVG}animateMotion")) is not None
    )


def test_chain_closes_only_around_a_ring_without_gate() -> None:
    ends = {}
    for more_cm in (None, 3, 6):
        seen = ChainRecorder()
        outcome = run_trial(Trial(world=ring(more_cm), noise="none"), seen)
        ends[more_cm] = outcome.outcome, len(seen.gaps), len(seen.marks)
        if more_cm == 3:
            low_m, high_m = sorted(y_m for _, y_m in seen.gaps[0])
            assert low_m < 1.6 < high_m, "the gap is at the gate"
    assert ends == {None: ("unreachable", 0, 1), 3: ("lost", 1, 1), 6: ("reached", 0, 1)}


def test_committed_proof_is_that_of_the_present_navigator() -> None:
    """Redraw the picture: `make pictures` if this fails, and look at the difference."""
    drawn = rings(PANEL_PX)
    for theme in THEMES:
        committed = (FOLDER / f"proof-{theme}.svg").read_text(encoding="utf-8")
        assert beside(TITLE, drawn, theme, RULES) == committed, theme
