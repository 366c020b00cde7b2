"""The memory of the navigators stays within bounds.

What a tick costs on the board is measured there: `checks/speed/board`.
"""

from random import Random

import pytest

from checks.speed.board.memory_size import lengths, state_bytes
from checks.speed.board.results import STATE_BYTES
from checks.speed.board.scenarios import CarriedBody, EnclosedBody, ScenarioBody
from robot.core import states
from robot.core.motion import HALT
from robot.core.navigators.registry import NAVIGATORS as REGISTERED
from robot.core.navigators.registry import new_memory
from robot.core.parameters import DEFAULTS
from robot.core.perception import sonar_ring as rings
from robot.core.values import Goal, Outputs, Pose, wrap
from study.trial.trial import NAVIGATORS
from tests.support.each import each

AWAY = Goal(9.0, 4.0, None, 0.05, 0.05)


def test_every_registered_navigator_has_a_name() -> None:
    assert set(NAVIGATORS.values()) == set(REGISTERED)


@each("name", NAVIGATORS)
def test_memory_of_a_navigator_is_within_its_limit(name: str) -> None:
    assert 0 < state_bytes(name) <= STATE_BYTES


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


def body_of(kind: type[ScenarioBody]) -> ScenarioBody:
    assert kind in (EnclosedBody, CarriedBody)
    return (EnclosedBody if kind is EnclosedBody else CarriedBody)(DEFAULTS, Random(3), 3)
