"""The committed findings: open ones fail as their files state, fixed ones do not fail again."""

from html import escape
from pathlib import Path

import pytest

import study.falsify
from plant.placement.shortest_path import shortest_path_m
from study.falsify.finding import read
from study.falsify.properties import LETTERS
from study.falsify.shrink import walls_in
from verification.findings import renewed

WORLDS = Path(study.falsify.__file__).parent / "worlds"
OPEN, FIXED, PAPER = (sorted((WORLDS / name).glob("*.toml")) for name in ("open", "fixed", "paper"))
EVERY = [*OPEN, *FIXED, *PAPER]


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


def test_every_finding_is_in_a_folder_that_is_tested() -> None:
    assert sorted(WORLDS.rglob("*.toml")) == sorted(EVERY)


@pytest.mark.parametrize("file", FIXED, ids=name_of)
def test_fixed_finding_does_not_fail_again(file: Path) -> None:
    finding = read(file)
    assert finding.fixed, "the line '# fixed: ' with the subject of the commit is missing"
    assert not set(finding.replay().violated) & {finding.letter, "b", "c"}, finding.sentence


@pytest.mark.parametrize("file", [*OPEN, *PAPER], ids=name_of)
def test_failing_finding_ends_as_its_file_states(file: Path) -> None:
    stored, now = read(file), renewed(file)
    assert now is not None, "it holds now: move the file to fixed/"
    assert (now.kind, now.sentence, now.world.name) == (stored.kind, stored.sentence, file.stem), (
        "run `python -m verification.findings`"
    )
    assert now == stored
    assert f"<title>{escape(stored.sentence)}</title>" in file.with_suffix(".svg").read_text()


@pytest.mark.parametrize(
    ("navigator", "side"), [("bug", "left"), ("bug", "right"), ("vgm", "left")]
)
def test_paper_method_has_a_counterexample_of_three_walls(navigator: str, side: str) -> None:
    subjects = [one.subject for one in map(read, PAPER) if walls_in(one.world) <= 3]
    assert (navigator, side) in {(one.navigator, one.side) for one in subjects}
    assert len(subjects) == len(PAPER)


def test_five_classes_of_failure_are_known() -> None:
    known = {(one.letter, one.world.family, one.kind) for one in map(read, (*OPEN, *FIXED))}
    assert len(known) >= 5
