"""Pictures of the documentation: whole, small, and without anything from another host."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from plant.world.file import load
from study.report.charts.drives import drive_trial
from study.trial.trial import Trial
from verification.site.pictures import FOLDER, NAVIGATORS, THEMES, WORLDS, moving, panels

PICTURES = sorted(FOLDER.glob("*.svg"))
SVG = "{http://www.w3.org/2000/svg}"


def test_all_pictures_are_committed() -> None:
    names = {f"navigators-{world}-{theme}.svg" for world in WORLDS for theme in THEMES}
    assert {path.name for path in PICTURES} == names | {"drive.svg"}


@pytest.mark.parametrize("path", PICTURES, ids=lambda path: path.stem)
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
