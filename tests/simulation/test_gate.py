"""The gate: 500 seeds of 20 simulated seconds violate no invariant, and defects are found."""

from functools import partial

import pytest

from verification.simulation.campaign import run_seeds, search_defect
from verification.simulation.draw import draw_scenario
from verification.simulation.events import to_json
from verification.simulation.shrink import shrink
from verification.simulation.simulation import run

SEEDS = 500
PART = 25


@pytest.mark.parametrize("first", range(0, SEEDS, PART))
def test_no_seed_violates_an_invariant(first: int) -> None:
    failed = run_seeds(range(first, first + PART)).failed
    assert not failed, "\n".join(
        f"sidestep bench simulate --seed {one.scenario.seed} --replay: {one.violation}"
        for one in failed
    )


@pytest.mark.parametrize(
    ("defect", "invariant"),
    [
        ("A1", "acknowledged stop is effective"),
        ("A13a", "acknowledged change survives"),
    ],
)
def test_defect_that_is_put_back_is_found(defect: str, invariant: str) -> None:
    found = search_defect(defect, most=200).found
    assert found is not None
    assert found.violation is not None
    assert found.violation.invariant == invariant


def test_violation_is_reproducible_and_shrinks_to_few_events() -> None:
    found = search_defect("A14", most=200).found
    assert found is not None
    assert found.violation is not None
    assert found.violation.invariant == "as safe as configured"
    again = run(draw_scenario(found.scenario.seed), "A14")
    assert (again.digest, again.violation) == (found.digest, found.violation)
    small = shrink(found, partial(run, defect="A14"))
    assert len(small.scenario.events) < len(found.scenario.events)
    assert len(small.scenario.events) <= 2, to_json(small.scenario)
    assert run(small.scenario, "A14").digest == small.digest
