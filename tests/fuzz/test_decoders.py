"""Every decoder accepts good input and only refuses other input."""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checks.fuzz import hunt as fuzz
from checks.fuzz.hunt import TARGETS, limited, watch
from checks.fuzz.target import FuzzTarget
from tests.support.each import each

FEW = settings().max_examples // 10
BEYOND = 10_000
"""The number of an input that is a mutation."""

every_target = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)


def try_input(target: FuzzTarget, data: bytes) -> bool:
    with TemporaryDirectory() as folder, watch(), limited(10.0):
        return target.accepts(data, Path(folder))


@each("target", TARGETS.values())
def test_good_samples_are_accepted(target: FuzzTarget) -> None:
    assert [try_input(target, sample) for sample in target.good].count(False) == 0
    assert target.good


@every_target
@settings(max_examples=FEW, deadline=None)
@given(data=st.binary(max_size=300))
def test_random_bytes_only_cause_refusals(target: FuzzTarget, data: bytes) -> None:
    try_input(target, data)


@every_target
@settings(max_examples=FEW, deadline=None)
@given(seed=st.integers(0, 1 << 32))
def test_mutated_samples_only_cause_refusals(target: FuzzTarget, seed: int) -> None:
    try_input(target, target.input(seed, BEYOND))


def test_same_seed_and_number_give_the_same_input() -> None:
    for target in TARGETS.values():
        assert target.input(3, BEYOND) == target.input(3, BEYOND)
    world = TARGETS["world"]
    assert len({world.input(3, BEYOND + number) for number in range(50)}) > 40


def test_short_hunt_finds_nothing() -> None:
    parser = argparse.ArgumentParser()
    fuzz.add_options(parser)
    report = fuzz.measure(parser.parse_args(["--inputs", "40", "--jobs", "1"]))
    assert report.met, report.text()
    assert report.figures[0].median >= 40
