"""The gate: 500 seeds of 20 simulated seconds violate no invariant, and defects are found."""

from functools import partial

import pytest

from verification.simulation.campaign import hunted, ran
from verification.simulation.draw import drawn
from verification.simulation.events import to_json
from verification.simulation.shrink import shrunk
from verification.simulation.simulation import run

SEEDS = 500
PART = 25


@pytest.mark.parametrize("first", range(0, SEEDS, PART))
def test_no_seed_violates_an_invariant(first: int) -> None:
    failed = ran(range(first, first + PART)).failed
    assert not failed, "\n".join(
        f"sidestep bench simulate --seed {one.scenario.seed} --replay: {one.violation}"
        for one in failed
    )


@pytest.mark.parametrize(
    ("defect", "invariant"),
    [
        ("A1", "an acknowledged stop is a stop"),
        ("A13a", "acknowledged survives"),
    ],
)
def test_a_defect_that_is_put_back_is_found(defect: str, invariant: str) -> None:
    found = hunted(defect, most=200).found
    assert found is not None
    assert found.violation is not None
    assert found.violation.invariant == invariant


def test_what_is_found_shrinks_to_few_events_and_repeats_to_the_bit() -> None:
    found = hunted("A14", most=200).found
    assert found is not None
    assert found.violation is not None
    assert found.violation.invariant == "as safe as configured"
    again = run(drawn(found.scenario.seed), "A14")
    assert (again.digest, again.violation) == (found.digest, found.violation)
    small = shrunk(found, partial(run, defect="A14"))
    assert len(small.scenario.events) < len(found.scenario.events)
    assert len(small.scenario.events) <= 2, to_json(small.scenario)
    assert run(small.scenario, "A14").digest == small.digest
