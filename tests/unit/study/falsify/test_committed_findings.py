"""The committed findings: open ones still fail, mended ones do not fail again.

Move a file from `open` to `mended` when a change of the navigator mends it.
"""

from pathlib import Path

import pytest

import study.falsify
from plant.placement.shortest_path import shortest_path_m
from study.falsify.finding import read
from study.falsify.properties import LETTERS
from study.falsify.shrink import walls_in

WORLDS = Path(study.falsify.__file__).parent / "worlds"
OPEN, MENDED, PAPER = (
    sorted((WORLDS / name).glob("*.toml")) for name in ("open", "fixed", "paper")
)
EVERY = [*OPEN, *MENDED, *PAPER]


def name_of(file: Path) -> str:
    return f"{file.parent.name}-{file.stem}"


@pytest.mark.parametrize("file", EVERY, ids=name_of)
def test_finding_states_its_property_and_its_shortest_way(file: Path) -> None:
    finding = read(file)
    assert finding.letter in LETTERS
    assert finding.sentence.endswith(".")
    length_m = shortest_path_m(finding.world)
    assert (length_m is not None) == finding.world.reachable
    assert length_m == pytest.approx(finding.world.shortest_path_m, abs=2e-3)


@pytest.mark.parametrize("file", EVERY, ids=name_of)
def test_finding_ends_as_its_folder_states(file: Path) -> None:
    finding = read(file)
    violated = finding.replay().violated
    if file.parent.name == "fixed":
        assert not set(violated) & {finding.letter, "b", "c"}, finding.sentence
    else:
        assert finding.letter in violated, "it holds now: move the file to fixed/"


@pytest.mark.parametrize("navigator", ["bug", "vgm"])
def test_paper_method_has_a_counterexample_of_three_walls(navigator: str) -> None:
    found = [finding for finding in map(read, PAPER) if finding.subject.navigator == navigator]
    assert found
    assert all(walls_in(finding.world) <= 3 for finding in found)


def test_five_classes_of_failure_are_known() -> None:
    known = {(one.letter, one.world.family, one.kind) for one in map(read, (*OPEN, *MENDED))}
    assert len(known) >= 5
