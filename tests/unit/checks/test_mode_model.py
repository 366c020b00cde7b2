"""The model of modes, missions and lease has no violation and finds each planted defect."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from checks.model import model_world
from checks.model.events import REQUESTS, VARIANTS, failsafe_causes, name_of
from checks.model.exploration import (
    DRAWINGS,
    HEADER,
    INVARIANTS,
    ModelPart,
    endless,
    explore,
    parts,
    rule_of,
    section,
    stop_takes_effect_at_once,
)
from checks.model.model_world import ADA, ModelWorld
from protocol.wire.messages import GoalRequest
from robot import vehicle
from robot.commands import TABLE
from robot.core import brain, modes, reasons, states
from robot.core import modes as machine
from robot.core.safety import failsafe
from robot.core.safety.failsafe import ROWS
from robot.core.values import Goal, Twist
from robot.lease import Lease
from robot.mission import MissionExecutor
from robot.parameter_service import ParameterService
from robot.process import SERVICES

DOCUMENT = Path(__file__).parents[3] / "docs" / "evidence" / "state-diagram.md"
PARTS = {part.name: part for part in parts()}


@pytest.mark.parametrize("part", parts(), ids=lambda part: part.name)
def test_every_state_obeys_the_rules_and_is_drawn(part: ModelPart) -> None:
    found = explore(part.events)
    broken = [str(one) for one in found.violations.values()]
    assert broken == [], "\n".join(broken)
    assert endless(found) == []
    assert section(part, found) in DOCUMENT.read_text(encoding="utf-8"), "run make generate-docs"


def test_document_names_every_rule_and_drawing() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    titles = [drawing.title for drawings in DRAWINGS.values() for drawing in drawings]
    assert text.startswith(HEADER)
    assert all(f"- {rule_of(rule)}" in text for rule in INVARIANTS)
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == titles


def test_events_cover_all_commands_requests_and_failsafes() -> None:
    assert VARIANTS.keys() == TABLE.keys()
    assert {kind for service in SERVICES for kind in service.requests} <= REQUESTS.keys()
    names = {event.name for event in failsafe_causes()}
    assert {f"tick with {name_of(row.reason)}" for row in ROWS} <= names


def test_requests_change_no_perception() -> None:
    world = ModelWorld()
    world.present = frozenset({ADA})
    for _ in range(3):
        world.tick()
    for part in parts():
        for event in part.events:
            if event.keeps_perception:
                before = model_world.capture(world)
                event.act(world)
                assert contents(model_world.capture(world)) == contents(before), event.by
                model_world.restore(before, perception=True)


def contents(captured: model_world.Memento) -> list[object]:
    return [what for _, what in captured.perception]


def test_memento_restores_a_world() -> None:
    world = ModelWorld()
    world.tick()
    before = model_world.capture(world)
    for event in PARTS["modes"].events:
        if event.enabled(world):
            event.act(world)
    assert world.vehicle.state.machine.vehicle != states.STANDBY
    model_world.restore(before, perception=True)
    after = model_world.capture(world)
    assert [what for _, what in after.control] == [what for _, what in before.control]
    assert contents(after) == contents(before)


# Each rule can fail: a defect is planted, and the model must find it.

Patch = pytest.MonkeyPatch


def trip_without_effect(patch: Patch) -> None:
    rows = tuple(row._replace(action=lambda *_: None) for row in ROWS)
    patch.setattr(failsafe, "ROWS", rows)


def trip_that_turns_wheels(patch: Patch) -> None:
    patch.setattr(brain, "HALT", Twist(0.1, 0.0))


def operator_never_lost(patch: Patch) -> None:
    rows = tuple(
        row._replace(trigger=lambda *_: False) if row.reason == reasons.OPERATOR_LOST else row
        for row in ROWS
    )
    patch.setattr(failsafe, "ROWS", rows)


def any_program_will_do(patch: Patch) -> None:
    def age_ms(robot: vehicle.RobotVehicle, now_ns: int) -> int | None:
        return vehicle.age_in_ms(robot.lease.beaten_ns(""), now_ns)

    patch.setattr(vehicle.RobotVehicle, "operator_age_ms", age_ms)


def mission_takes_the_mode(patch: Patch) -> None:
    set_off = MissionExecutor._set_off

    def to_auto(mission: MissionExecutor, *how: Any) -> int:
        refusal = set_off(mission, *how)
        if refusal == reasons.OK:
            mission._machine.mode = states.AUTO
        return refusal

    patch.setattr(MissionExecutor, "_set_off", to_auto)


def clear_arms(patch: Patch) -> None:
    def clear(machine: machine.Machine) -> int:
        if machine.vehicle == states.EMERGENCY_STOP:
            machine.vehicle = states.ACTIVE
        return reasons.OK

    patch.setattr(modes, "clear_estop", clear)


def arm_without_fence(patch: Patch) -> None:
    arm = modes.arm

    def careless(machine: machine.Machine) -> int:
        was, machine.fence_unreadable = machine.fence_unreadable, False
        reason = arm(machine)
        machine.fence_unreadable = was
        return reason

    patch.setattr(modes, "arm", careless)


def goals_without_a_place(patch: Patch) -> None:
    goto = modes.goto

    def anywhere(machine: machine.Machine, goal: Goal, mode: int, now_ms: int, *_: bool) -> int:
        return goto(machine, goal, mode, now_ms, from_robot=True)

    patch.setattr(modes, "goto", anywhere)


def fence_without_a_place(patch: Patch) -> None:
    rows = tuple(row for row in ROWS if row.reason != reasons.FENCE_UNCHECKED)
    patch.setattr(failsafe, "ROWS", rows)


def disarm_clears(patch: Patch) -> None:
    def disarm(machine: machine.Machine, _now_ms: int) -> int:
        machine.vehicle = states.STANDBY
        return reasons.OK

    patch.setattr(modes, "disarm", disarm)


def estop_only_when_armed(patch: Patch) -> None:
    estop = modes.estop

    def lazy(machine: machine.Machine, now_ms: int) -> int:
        return estop(machine, now_ms) if machine.vehicle == states.ACTIVE else reasons.OK

    patch.setattr(modes, "estop", lazy)


def two_commanders(patch: Patch) -> None:
    patch.setattr(Lease, "allows", lambda *_: True)


def strangers_command(patch: Patch) -> None:
    patch.setattr(vehicle, "needs_no_lease", lambda request: isinstance(request, GoalRequest))


def refusal_with_effect(patch: Patch) -> None:
    def abort(machine: machine.Machine, _now_ms: int) -> int:
        machine.mode = states.HOLD
        return reasons.NOTHING_TO_ABORT

    patch.setattr(modes, "abort", abort)


def end_without_reason(patch: Patch) -> None:
    end_goal = machine.end_goal

    def silent(machine: machine.Machine, goal_state: int, _reason: int, now_ms: int) -> None:
        end_goal(machine, goal_state, reasons.OK, now_ms)

    patch.setattr(machine, "end_goal", silent)


def disarm_keeps_the_goal(patch: Patch) -> None:
    def disarm(machine: machine.Machine, _now_ms: int) -> int:
        if machine.vehicle in (states.ACTIVE, states.FAILSAFE):
            machine.vehicle = states.STANDBY
        return reasons.OK

    patch.setattr(modes, "disarm", disarm)


def mission_ignores_the_vehicle(patch: Patch) -> None:
    patch.setattr(MissionExecutor, "reason_to_end", lambda _: reasons.OK)


def safety_group_is_empty(patch: Patch) -> None:
    patch.setattr(ParameterService, "_unsafe", lambda *_: reasons.OK)


DEFECTS: tuple[tuple[Callable[[Patch], None], str, str], ...] = (
    (trip_that_turns_wheels, "modes", "wheels_turn_only_on_command"),
    (operator_never_lost, "modes", "operator_modes_need_an_operator"),
    (any_program_will_do, "two programs of a person", "a_drive_needs_its_program"),
    (mission_takes_the_mode, "missions", "only_requests_change_the_mode"),
    (clear_arms, "modes", "only_arming_arms"),
    (arm_without_fence, "fence and settings", "lost_fence_prevents_arming"),
    (goals_without_a_place, "place", "world_needs_a_place"),
    (fence_without_a_place, "place", "fence_needs_a_place"),
    (disarm_clears, "modes", "only_clear_ends_an_emergency_stop"),
    (estop_only_when_armed, "modes", "stop_takes_effect_at_once"),
    (trip_without_effect, "modes", "failsafe_stops_at_once"),
    (two_commanders, "lease", "only_the_holder_commands"),
    (strangers_command, "requests without the lease", "other_operators_change_nothing"),
    (refusal_with_effect, "modes", "refusal_changes_nothing"),
    (end_without_reason, "modes", "every_end_has_a_reason"),
    (disarm_keeps_the_goal, "modes", "disarmed_robot_has_no_goal"),
    (mission_ignores_the_vehicle, "missions", "disarmed_robot_has_no_mission"),
    (
        safety_group_is_empty,
        "fence and settings",
        "safety_parameters_stay_safe",
    ),
)


@pytest.mark.parametrize(
    ("defect", "part", "rule"), DEFECTS, ids=lambda value: getattr(value, "__name__", None)
)
def test_model_finds_planted_defect(
    defect: Callable[[Patch], None], part: str, rule: str, monkeypatch: Patch
) -> None:
    defect(monkeypatch)
    wanted = rule_of(next(one for one in INVARIANTS if one.__name__ == rule))
    found = explore(PARTS[part].events, until=wanted)
    assert wanted in {one.rule for one in found.violations.values()}


def test_every_rule_has_a_defect() -> None:
    assert [rule for *_, rule in DEFECTS] == [rule.__name__ for rule in INVARIANTS]


def test_model_finds_a_goal_without_an_end(monkeypatch: Patch) -> None:
    monkeypatch.setattr(modes, "abort", lambda *_: reasons.NOTHING_TO_ABORT)
    monkeypatch.setattr(modes, "disarm", lambda *_: reasons.OK)
    monkeypatch.setattr(modes, "estop", lambda *_: reasons.OK)
    wanted = ("arm", "goto in AUTO", "pause", "tick")
    events = [event for event in PARTS["modes"].events if event.name in wanted]
    assert endless(explore(events)) != []


def test_counterexample_is_shortest(monkeypatch: Patch) -> None:
    estop_only_when_armed(monkeypatch)
    found = explore(PARTS["modes"].events, until=rule_of(stop_takes_effect_at_once))
    first = min(found.violations.values(), key=lambda one: len(one.events))
    assert first.events == ("ada: stop",)
    assert str(first).startswith("Every stop, of any sender, leads to EMERGENCY_STOP")
