"""What a tick would cost on the LPC1768, and what the navigators' memories take, stays in bounds.

The counts depend on nothing but the source and its inputs, so they may be asserted anywhere. A
navigator that is over its limit: `sidestep bench budget --navigators NAME --dearest` says where.
"""

from collections import Counter
from importlib import import_module
from random import Random
from typing import Any

import pytest

from benchmarks.mcu_cost.budget import LIMIT_PERCENT, LIMITS_PERCENT, STATE_BYTES, hard_ticks
from benchmarks.mcu_cost.counted_core import WeighedCore
from benchmarks.mcu_cost.hardest import Body, Carried, ShutIn, told
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

STORIES, TICKS = 4, 80
"""With twice as many stories the worst tick costs at most 0.3 percentage points more."""
AWAY = Goal(9.0, 4.0, None, 0.05, 0.05)


class Real:
    """The core itself where a weighed one is expected: nothing is counted."""

    def __getitem__(self, name: str) -> Any:
        return import_module(f"robot.core.{name}")

    def take(self) -> dict[str, Counter[str]]:
        return {}


def test_every_registered_navigator_has_a_name_and_so_a_limit() -> None:
    assert set(NAVIGATORS.values()) == set(REGISTERED)


@pytest.mark.parametrize("name", NAVIGATORS)
def test_the_worst_tick_and_the_memory_stay_within_their_limits(name: str) -> None:
    weights = hard_ticks(name, STORIES, TICKS)
    worst = weights.worst()
    dearest = sorted(worst.functions.items(), key=lambda item: -item[1])[:8]
    assert share_percent(worst.instructions) <= LIMITS_PERCENT.get(name, LIMIT_PERCENT), dearest
    assert weights.memory_bytes <= STATE_BYTES


@pytest.mark.parametrize("kind", [ShutIn, Carried])
@pytest.mark.parametrize("name", NAVIGATORS)
def test_a_memory_has_its_full_length_from_the_start(name: str, kind: type[Body]) -> None:
    """2000 ticks with one memory, whatever it decides; without a machine that would end it."""
    number, ring = NAVIGATORS[name], rings.Ring()
    memory, body = new_memory(number, states.LEFT), made_up(kind)
    before = lengths(memory)
    for tick in range(2000):
        rings.update(ring, body.scan(), 50 * tick, DEFAULTS)
        pose = Pose(body.x_m, body.y_m, wrap(body.heading_rad))
        decision = REGISTERED[number].step(memory, pose, ring, AWAY, DEFAULTS)
        turn_rad = wrap(decision.goal_bearing_rad + decision.rotation_rad)
        yaw = max(-900, min(900, int(3000 * turn_rad)))
        speed = 3000 if abs(turn_rad) < 0.5 and ring.front_m > 0.1 else 0
        body.drive(Outputs(speed - 3 * yaw, speed + 3 * yaw, 0, HALT, None))
        assert lengths(memory) == before


@pytest.mark.parametrize("name", NAVIGATORS)
def test_the_weighed_core_does_what_the_core_does(name: str) -> None:
    params = DEFAULTS._replace(navigator=NAVIGATORS[name])
    real, weighed = Real(), WeighedCore()
    states_of = real["brain"].State(params), weighed["brain"].State(params)
    drives = (
        told(real, states_of[0], ShutIn(params, Random(5), 2)),
        told(weighed, states_of[1], ShutIn(params, Random(5), 2)),
    )
    for one, other in zip(*drives, strict=True):
        assert tuple(one.twist) == tuple(other.twist)
        assert tuple(one.odometry.pose) == tuple(other.odometry.pose)
        assert (one.decision and tuple(one.decision)) == (other.decision and tuple(other.decision))
    assert states_of[0].machine.serial == states_of[1].machine.serial > 0


def made_up(kind: type[Body]) -> Body:
    assert kind in (ShutIn, Carried)
    return (ShutIn if kind is ShutIn else Carried)(DEFAULTS, Random(3), 3)
