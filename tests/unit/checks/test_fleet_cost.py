"""The model of what a fleet costs."""

import pytest

from checks.speed.fleet_cost import FleetCost, figures_of, model_of, notes_of

TRUE = (1.5, 0.8, 0.3)


def fleet(robots: int, processes: int) -> FleetCost:
    """Return a fleet whose cost is exactly that of the true model, with a speed of 0.5."""
    of_fleet_ms, of_robot_ms, of_process_ms = TRUE
    whole_ms = of_fleet_ms + robots * of_robot_ms + processes * of_process_ms
    return FleetCost(robots, processes, 0.5, {"plant": 0.25 * whole_ms, "robot": 0.75 * whole_ms})


def test_model_finds_the_shares_of_fleet_robot_and_process() -> None:
    model = model_of([fleet(1, 1), fleet(100, 4), fleet(8, 8), fleet(8, 1)])
    assert model == pytest.approx(TRUE)
    assert model.tick_ms(30, 4) == pytest.approx(fleet(30, 4).whole_ms)


def test_notes_have_the_error_of_the_model_and_the_fleet_on_paper() -> None:
    costs = [fleet(1, 1), FleetCost(30, 4, 0.5, {"robot": 13.35}), fleet(100, 4)]
    model = model_of([costs[0], costs[-1], fleet(8, 8), fleet(8, 1)])
    text = "\n".join(notes_of(costs, model, 1))
    assert "30 in 4: 26.7 ms (+100 %), 100 in 4: 82.7 ms (" in text
    assert "on paper: 1000 robots in 40 processes: 81" in text
    assert "ms a tick, 16 cores at 20 Hz" in text


def test_goal_and_bound_stand_beside_the_speed() -> None:
    speed, bound, _ = figures_of(fleet(100, 4))
    assert (speed.at_least, speed.median, speed.met) == (0.4, 0.5, True)
    assert bound.median > 0.5
