"""Seeds of 20 simulated seconds violate no invariant, drive everywhere, and find defects."""

from functools import partial

import pytest

from checks.simulation.campaign import draw_scenario, run, run_seeds, search_defect, shrink
from checks.simulation.events import to_json

SEEDS = 500
PART = 20


@pytest.mark.sweep(25)
@pytest.mark.parametrize("first", range(0, SEEDS, PART))
def test_seeds_reach_all_modes_and_violate_no_invariant(first: int) -> None:
    found = run_seeds(range(first, first + PART))
    assert not found.failed, "\n".join(
        f"sidestep bench simulate --seed {one.scenario.seed} --replay: {one.violation}"
        for one in found.failed
    )
    coverage = found.coverage
    assert coverage.moving_percent > 8.0
    assert coverage.accepted > 100
    for name in ("MANUAL", "AUTO", "GUIDED", "HOLD"):
        assert coverage.reached[f"ACTIVE {name}"] > 0, name
    assert coverage.reached["EMERGENCY_STOP"] > 0


@pytest.mark.sweep(4)
@pytest.mark.parametrize(
    ("defect", "invariant"),
    [
        ("A13a", "acknowledged change survives"),
        ("A1", "acknowledged stop is effective"),
        ("d2", "stopped in time"),
        ("d3", "only the lease holder commands"),
        ("d1", "stop is acknowledged in time"),
        ("d4", "only a later clear releases a stop"),
        ("d5", "only the lease holder commands"),
        ("d6", "inside the fence"),
        ("d8", "only the driver steers"),
        ("d9", "who may command is not refused"),
        ("d10", "lease expires"),
        ("kept", "stop survives a restart"),
        ("unkept", "stop survives a restart"),
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
