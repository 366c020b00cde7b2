import pytest

from protocol.wire.enums import Navigator as Numbers
from robot.core import reasons, states
from robot.core.navigators import classical, registry
from robot.core.navigators.registry import NAVIGATORS, Navigator
from robot.core.parameters import DEFAULTS
from robot.core.values import Decision
from study.trial.trial import NAVIGATORS as NAMES
from tests.support.each import each
from tests.support.robot.core.driving import AHEAD, armed


def test_every_navigator_of_the_dialect_is_registered() -> None:
    assert set(NAVIGATORS) == {int(number) for number in Numbers}
    assert dict(NAMES) == {number.name.lower(): int(number) for number in Numbers}


@each("number", NAVIGATORS)
@each("side", [states.LEFT, states.RIGHT])
def test_new_memory_has_the_requested_side(number: int, side: int) -> None:
    one, other = registry.new_memory(number, side), registry.new_memory(number, side)
    assert one is not other
    assert one.side == side


@each("number", NAVIGATORS)
def test_every_navigator_drives_through_open_space_to_the_goal(number: int) -> None:
    driven = armed(DEFAULTS._replace(navigator=number))
    assert driven.goto() == reasons.OK
    driven.forward(20.0)
    assert driven.machine.goal_state == states.REACHED


def test_a_goal_takes_the_memory_of_the_navigator_that_is_chosen() -> None:
    driven = armed()
    driven.machine.navigator = states.BUG2
    assert driven.goto() == reasons.OK
    first = driven.forward(0.1).state.memory
    assert isinstance(first, classical.Bug2Memory)
    assert driven.forward(0.1).state.memory is first
    assert driven.goto() == reasons.OK
    assert driven.forward(0.1).state.memory is not first


def chosen(branch: int, speed_limit_m_s: float) -> Navigator:
    """Return a step with a constant decision."""

    def step(*_: object, **__: object) -> Decision:
        return Decision(branch, None, 9.0, 0.0, 0.0, AHEAD.x_m, AHEAD.y_m, speed_limit_m_s)

    return Navigator(NAVIGATORS[states.BUG].memory, step, True)


def test_giving_up_ends_the_goal_stuck_because_it_is_unreachable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(NAVIGATORS, DEFAULTS.navigator, chosen(states.GIVE_UP, 0.3))
    driven = armed()
    assert driven.goto() == reasons.OK
    driven.forward(1.0)
    machine = driven.machine
    assert (machine.goal_state, machine.goal_reason) == (states.STUCK, reasons.UNREACHABLE)
    assert driven.stands


def test_the_speed_limit_of_a_navigator_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NAVIGATORS, DEFAULTS.navigator, chosen(states.TO_GOAL, 0.07))
    driven = armed()
    assert driven.goto() == reasons.OK
    driven.forward(2.0)
    assert driven.outputs.twist.speed_m_s == pytest.approx(0.07)


def test_navigator_judging_progress_has_no_time_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ends = []
    for judges in (True, False):
        turning = chosen(states.TO_GOAL, 0.0)
        moving = Navigator(turning.memory, turning.step, judges)
        monkeypatch.setitem(NAVIGATORS, DEFAULTS.navigator, moving)
        driven = armed(DEFAULTS._replace(progress_ms=1000))
        assert driven.goto() == reasons.OK
        driven.forward(2.0)
        ends.append(driven.machine.goal_reason)
    assert ends == [reasons.OK, reasons.NO_PROGRESS]
