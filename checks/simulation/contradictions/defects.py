"""Fixed defects of words, which can be put back to check that the observer finds them.

Each is a patch of product code in this process, as in `checks.simulation.defects`.
"""

from importlib import import_module
from typing import Any, Final

from checks.simulation.defects import Defect, Patches
from protocol.outcome import REPLACED
from protocol.topics import COMMAND, STATUS
from protocol.wire.enums import Command, MissionState
from protocol.wire.reasons import Reason


def _any_goal() -> Patches:
    """Judge `up` by the goal that has ended, whosever it is."""
    run = import_module("ground.launch.goal_run").GoalRun
    look = run.look

    def looked(self: Any) -> None:
        newest, watch = self.telemetry.latest(STATUS), self._watch
        is_replaced = watch is not None and watch.end is not None and watch.end.outcome == REPLACED
        if not is_replaced or self.outcome is not None:
            look(self)
        elif newest[0].goal_ended_ns:
            self._end(newest[0])

    def judged(self: Any, status: Any, end: Any = None) -> None:
        if end is None or end.outcome != REPLACED:
            ended(self, status, end)

    ended = run._end
    return {
        "ground.launch.goal_run.GoalRun.look": looked,
        "ground.launch.goal_run.GoalRun._end": judged,
    }


def _unbound_clean_up() -> Patches:
    """End whatever the robot does, when a drive is cleaned up."""
    links = import_module("ground.client.link")

    def end(self: Any, request: Any, ends_id: int, attempts: int = 1) -> Any:
        if not ends_id:
            return None
        now_ns = self.clock.now_ns()
        ending = links.CommandExchange(request, now_ns, attempts=attempts, patience_ns=links.END_NS)
        links.run_exchange(self.bus, self.clock, self.robot, ending, COMMAND)
        return ending.outcome

    return {"ground.client.link.Link.end": end}


def _stop_with_lease_only() -> Patches:
    """Refuse hold, abort and disarm to whoever has not the lease."""
    original = import_module("robot.lease").needs_no_lease

    def needs_no_lease(request: Any) -> bool:
        number = getattr(request, "command", None)
        return bool(original(request)) and number in (None, Command.DO_FLIGHTTERMINATION)

    return {
        "robot.vehicle.needs_no_lease": needs_no_lease,
    }


def _lost_for_replaced() -> Patches:
    """Report a robot whose goal was replaced as one that does not answer."""
    run = import_module("ground.launch.goal_run").GoalRun
    ended = run._end

    def end(self: Any, status: Any, end: Any = None) -> None:
        if end is None or end.outcome != REPLACED:
            ended(self, status, end)
        else:
            self._lost(lambda: f"replaced by a new goal: {self.link.diagnosis()}")

    return {"ground.launch.goal_run.GoalRun._end": end}


def _lease_of_a_program() -> Patches:
    """Give the lease to a program instead of a person."""
    return {"robot.lease.person_of": lambda operator: operator}


def _constant_limit() -> Patches:
    """Promise a stop after 1.5 s, whatever the robot's parameter is."""
    texts = import_module("ground.station.link.loss")
    original = texts._without_operator

    def without_operator(status: Any, op_lost_ms: Any) -> str:
        return str(original(status, 1500.0))

    return {"ground.station.link.loss._without_operator": without_operator}


def _stale_answer() -> Patches:
    """Accept a repeated command although what it made is gone."""
    repeats = import_module("gateways.mavlink.commands.command_protocol")

    def judged(self: Any, one: Any, *, is_copy: bool, is_marked: bool) -> Any:
        return repeats.Action.IGNORE if one.result is None else repeats.Action.ANSWER

    return {"gateways.mavlink.commands.command_protocol.Repeats._judged": judged}


def _stranger_to_itself() -> Patches:
    """Take a station that comes back from another port for another operator."""
    control = import_module("gateways.mavlink.operator_control")

    def held_by(station: Any, _sender: Any) -> Any:
        refused = control.Refused(Reason.LEASE_HELD, 0, control.name_of(station))
        return control.Answered(refused)

    return {
        "gateways.mavlink.operator_control.is_back": lambda _station, _sender: False,
        "gateways.mavlink.operator_control.held_by": held_by,
    }


def _failed_for_taken_over() -> Patches:
    """Call every mission failed that has not been completed."""
    return {
        "ground.client.operations.missions.mission_state": lambda state, *_: (
            MissionState(state).name
        )
    }


DEFECTS: Final[dict[str, Defect]] = {
    "c1": Defect("`up` reports the end of somebody else's goal", _any_goal),
    "c2": Defect("a clean-up ends what was begun since", _unbound_clean_up),
    "c3": Defect("what stops is refused without the lease", _stop_with_lease_only),
    "c4": Defect("a replaced goal is reported as a lost robot", _lost_for_replaced),
    "c5": Defect("the lease belongs to a program, not to a person", _lease_of_a_program),
    "c6": Defect("a screen promises a stop at a time that is not the robot's", _constant_limit),
    "c7": Defect("a repeated command is accepted though its effect is gone", _stale_answer),
    "c8": Defect(
        "a station that restarts is told that another operator commands", _stranger_to_itself
    ),
    "c9": Defect("a mission that was taken over is reported as failed", _failed_for_taken_over),
}
