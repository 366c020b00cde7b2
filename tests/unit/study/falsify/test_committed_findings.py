"""The committed findings: open ones fail as their files state, fixed ones do not fail again."""

from html import escape
from pathlib import Path

import pytest
from _pytest.mark.structures import ParameterSet

import study.falsify
from checks.site.findings import renewed
from plant.shortest_path import shortest_path_m
from study.falsify.findings import read_finding
from study.falsify.properties import LETTERS
from study.falsify.shrink import walls_in
from tests.support.each import each

WORLDS = Path(study.falsify.__file__).parent / "worlds"
OPEN, FIXED, PAPER = (sorted((WORLDS / name).glob("*.toml")) for name in ("open", "fixed", "paper"))
EVERY = [*OPEN, *FIXED, *PAPER]
SLOW = (
    "a-nested_rings-timeout-still",
    "b-double_spiral-claim",
    "b-hairpin-claim",
    "b-interlocking_spirals-claim",
    "b-island_room-claim",
    "b-island_room-claim-turn",
    "b-nested_boxes-claim",
    "b-nested_rings-claim",
    "b-nested_rings-claim-hop",
    "b-symmetric_trap-claim",
    "b-wedge-claim",
    "b-zigzag-claim-ghost",
    "c-double_spiral-contact-passing",
    "c-double_spiral-contact-passing-robot",
    "c-double_spiral-contact-stopped",
    "c-hairpin-contact-passing",
    "c-interlocking_spirals-contact-passing",
    "c-interlocking_spirals-contact-passing-robot",
    "c-interlocking_spirals-contact-stopped",
    "c-symmetric_trap-contact-passing",
    "c-symmetric_trap-contact-stopped-robot",
    "c-nested_rings-contact-passing-robot",
    "c-tight_door-contact-passing",
)
"""Drives of more than 0.4 s, each of the letter and kind of a quicker one."""


def row_of(file: Path) -> ParameterSet:
    marks = pytest.mark.sweep(len(SLOW)) if file.stem in SLOW else ()
    return pytest.param(file, marks=marks, id=f"{file.parent.name}-{file.stem}")


@each("file", EVERY)
def test_finding_states_its_property_and_its_shortest_way(file: Path) -> None:
    finding = read_finding(file)
    assert finding.letter in LETTERS
    assert finding.sentence.endswith(".")
    length_m = shortest_path_m(finding.world)
    assert (length_m is not None) == finding.world.reachable
    assert length_m == pytest.approx(finding.world.shortest_path_m, abs=2e-3)


def test_every_finding_is_in_a_folder_that_is_tested() -> None:
    assert sorted(WORLDS.rglob("*.toml")) == sorted(EVERY)
    assert set(SLOW) <= {file.stem for file in EVERY}


def test_each_letter_and_kind_has_a_quick_drive() -> None:
    quick, slow = (
        {
            (one.letter, one.kind)
            for one in map(read_finding, EVERY)
            if (one.world.name in SLOW) is which
        }
        for which in (False, True)
    )
    assert slow <= quick


@pytest.mark.parametrize("file", [row_of(file) for file in FIXED])
def test_fixed_finding_does_not_fail_again(file: Path) -> None:
    finding = read_finding(file)
    assert finding.fixed, "the line '# fixed: ' with the subject of the commit is missing"
    assert not set(finding.replay().violated) & {finding.letter, "b", "c"}, finding.sentence


@pytest.mark.parametrize("file", [row_of(file) for file in (*PAPER, *OPEN)])
def test_failing_finding_ends_as_its_file_states(file: Path) -> None:
    stored, now = read_finding(file), renewed(file)
    assert now is not None, "it holds now: move the file to fixed/"
    assert (now.kind, now.sentence, now.world.name) == (stored.kind, stored.sentence, file.stem), (
        "run `python -m checks.site.findings`"
    )
    assert now == stored
    assert f"<title>{escape(stored.sentence)}</title>" in file.with_suffix(".svg").read_text()


@each(("navigator", "side"), [("bug", "left"), ("bug", "right"), ("vgm", "left")])
def test_paper_method_has_a_counterexample_of_three_walls(navigator: str, side: str) -> None:
    subjects = [one.subject for one in map(read_finding, PAPER) if walls_in(one.world) <= 3]
    assert (navigator, side) in {(one.navigator, one.side) for one in subjects}
    assert len(subjects) == len(PAPER)


def test_five_classes_of_failure_are_known() -> None:
    known = {(one.letter, one.world.family, one.kind) for one in map(read_finding, (*OPEN, *FIXED))}
    assert len(known) >= 5
