"""Every decoder accepts valid input and raises only permitted errors for any other."""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from verification.fuzz import main as fuzz
from verification.fuzz.hunt import limited, watch
from verification.fuzz.target import Target
from verification.fuzz.targets import TARGETS

FEW = 25
BEYOND = 10_000
"""The number of an input that is no longer a sample."""

every_target = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)


def tried(target: Target, data: bytes) -> bool:
    with TemporaryDirectory() as folder, watch(), limited(10.0):
        return target.accepts(data, Path(folder))


@every_target
def test_valid_samples_are_accepted(target: Target) -> None:
    assert [tried(target, sample) for sample in target.good].count(False) == 0
    assert target.good


@every_target
@settings(max_examples=FEW, deadline=None)
@given(data=st.binary(max_size=300))
def test_any_bytes_are_accepted_or_refused(target: Target, data: bytes) -> None:
    tried(target, data)


@every_target
@settings(max_examples=FEW, deadline=None)
@given(seed=st.integers(0, 1 << 32))
def test_any_mutation_of_a_sample_is_accepted_or_refused(target: Target, seed: int) -> None:
    tried(target, target.input(seed, BEYOND))


def test_the_same_numbers_make_the_same_input() -> None:
    for target in TARGETS.values():
        assert target.input(3, BEYOND) == target.input(3, BEYOND)
    world = TARGETS["world"]
    assert len({world.input(3, BEYOND + number) for number in range(50)}) > 40


def test_a_short_hunt_through_all_of_them_finds_nothing() -> None:
    parser = argparse.ArgumentParser()
    fuzz.add_options(parser)
    report = fuzz.measure(parser.parse_args(["--inputs", "600"]))
    assert report.met, report.text()
    assert report.figures[0].median > 400
