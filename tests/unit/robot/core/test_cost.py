"""Modelled cost of a tick on the LPC1768 and memory of the navigators stay within bounds.

The counts depend only on the source and its inputs, so they may be asserted on any machine. For a
navigator over its limit, `sidestep bench budget --navigators NAME --dearest` lists the causes.
"""

from importlib import import_module
from random import Random
from typing import Any

import pytest

from benchmarks.mcu_cost.budget import LIMIT_PERCENT, LIMITS_PERCENT, STATE_BYTES, worst_case_ticks
from benchmarks.mcu_cost.counted_core import CountedCore
from benchmarks.mcu_cost.hardest import CarriedBody, EnclosedBody, ScenarioBody, run_scenario
from benchmarks.mcu_cost.mcu import share_percent
from benchmarks.mcu_cost.memory_size import lengths
from robot.core import states
from robot.core.geometry import wrap
from robot.core.motion.controller import HALT
from robot.core.navigators.registry import NAVIGATORS as REGISTERED
from robot.core.navigators.registry import new_memory
from robot.core.parameters import DEFAULTS
from robot.core.perception import sonar_ring as rings
from robot.core.values import Goal, Outputs, Pose
from study.trial.trial import NAVIGATORS

SCENARIOS, TICKS = 4, 80
"""Twice as many scenarios raise the cost of the worst tick by at most 0.3 percentage points."""
AWAY = Goal(9.0, 4.0, None, 0.05, 0.05)


class UncountedCore:
    """The original core with the interface of a counted one."""

    def __getitem__(self, name: str) -> Any:
        return import_module(f"robot.core.{name}")

    def clear(self) -> None:
        """Do nothing."""


@pytest.fixture(scope="module")
def counted_core() -> CountedCore:
    """Return a core for all tests: to instrument its source costs more than a scenario."""
    return CountedCore()


def test_every_registered_navigator_has_a_name() -> None:
    assert set(NAVIGATORS.values()) == set(REGISTERED)


@pytest.mark.parametrize("name", NAVIGATORS)
def test_worst_tick_and_memory_are_within_limits(name: str, counted_core: CountedCore) -> None:
    costs = worst_case_ticks(name, SCENARIOS, TICKS, counted_core)
    worst = costs.worst()
    dearest = sorted(worst.functions.items(), key=lambda item: -item[1])[:8]
    assert share_percent(worst.instructions) <= LIMITS_PERCENT.get(name, LIMIT_PERCENT), dearest
    assert costs.memory_bytes <= STATE_BYTES


@pytest.mark.parametrize("kind", [EnclosedBody, CarriedBody])
@pytest.mark.parametrize("name", NAVIGATORS)
def test_memory_never_grows(name: str, kind: type[ScenarioBody]) -> None:
    """Run 1000 ticks with one memory, whatever it decides, without a machine that would end it."""
    number, ring = NAVIGATORS[name], rings.Ring()
    memory, body = new_memory(number, states.LEFT), body_of(kind)
    before = lengths(memory)
    for tick in range(1000):
        rings.update(ring, body.scan(), 50 * tick, DEFAULTS)
        pose = Pose(body.x_m, body.y_m, wrap(body.heading_rad))
        decision = REGISTERED[number].step(memory, pose, ring, AWAY, DEFAULTS)
        turn_rad = wrap(decision.goal_bearing_rad + decision.rotation_rad)
        yaw = max(-900, min(900, int(3000 * turn_rad)))
        speed = 3000 if abs(turn_rad) < 0.5 and ring.front_m > 0.1 else 0
        body.drive(Outputs(speed - 3 * yaw, speed + 3 * yaw, 0, HALT, None))
        assert lengths(memory) == before


@pytest.mark.parametrize("name", NAVIGATORS)
def test_counted_core_behaves_like_the_core(name: str, counted_core: CountedCore) -> None:
    params = DEFAULTS._replace(navigator=NAVIGATORS[name])
    real = UncountedCore()
    states_of = real["brain"].State(params), counted_core["brain"].State(params)
    runs = (
        run_scenario(real, states_of[0], EnclosedBody(params, Random(5), 2), 100),
        run_scenario(counted_core, states_of[1], EnclosedBody(params, Random(5), 2), 100),
    )
    for one, other in zip(*runs, strict=True):
        assert tuple(one.twist) == tuple(other.twist)
        assert tuple(one.odometry.pose) == tuple(other.odometry.pose)
        assert (one.decision and tuple(one.decision)) == (other.decision and tuple(other.decision))
    assert states_of[0].machine.serial == states_of[1].machine.serial > 0


def body_of(kind: type[ScenarioBody]) -> ScenarioBody:
    assert kind in (EnclosedBody, CarriedBody)
    return (EnclosedBody if kind is EnclosedBody else CarriedBody)(DEFAULTS, Random(3), 3)
