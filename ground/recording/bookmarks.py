"""Find the bookmarks of a run: goals, outcomes, failsafes and the operator's marks."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from ground.recording.log_index import LogIndex
from ground.text.statustext import StatustextAssembler
from protocol.outcome import detail_of, goal_end
from protocol.topics import MARK, STATUS
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import reason_text
from runtime.units import NS_PER_S

STOPPED: Final = (Vehicle.FAILSAFE, Vehicle.EMERGENCY_STOP)


class Mark(NamedTuple):
    """An instant to jump to; `kind` is goal, outcome, failsafe or mark."""

    time_s: float
    kind: str
    text: str


def marks_in(log_index: LogIndex) -> tuple[Mark, ...]:
    """Return all bookmarks in order of time."""
    texts = StatustextAssembler()
    remarks = ((time_ns, texts.receive(message)) for time_ns, message in log_index.on(MARK.path))
    written = [Mark(time_ns / NS_PER_S, "mark", words) for time_ns, words in remarks if words]
    return tuple(sorted([*changes(log_index.on(STATUS.path)), *written]))


def changes(statuses: Iterable[tuple[int, Message]]) -> list[Mark]:
    """Return the bookmarks that status messages, each with its time in ns, imply."""
    found: list[Mark] = []
    goal_id, goal, vehicle = 0, int(GoalState.NONE), int(Vehicle.BOOT)
    for time_ns, status in statuses:
        if not isinstance(status, NavigatorStatus):
            continue
        at_s = time_ns / NS_PER_S
        if status.goal_id != goal_id and is_driven(status.goal):
            place = f"goal {status.goal_x_m:z.2f} {status.goal_y_m:z.2f}"
            if is_driven(goal):
                found.append(Mark(at_s, "outcome", f"REPLACED: by the {place}"))
            found.append(Mark(at_s, "goal", place))
            goal_id = status.goal_id
        if status.goal != goal and status.goal >= GoalState.REACHED:
            found.append(Mark(at_s, "outcome", outcome(status)))
        if status.vehicle != vehicle and status.vehicle in STOPPED:
            why = reason_text(status.vehicle_reason)
            found.append(Mark(at_s, "failsafe", f"{Vehicle(status.vehicle).name}: {why}"))
        goal, vehicle = status.goal, status.vehicle
    return found


def is_driven(goal: int) -> bool:
    """Return whether a goal has begun and not ended."""
    return GoalState.ACCEPTED <= goal <= GoalState.ALIGNING


def outcome(status: NavigatorStatus) -> str:
    """Return the goal state of a status with its reason."""
    try:
        name = GoalState(status.goal).name
    except ValueError:
        name = f"goal state {status.goal}"
    reason = reason_text(status.goal_reason)
    if status.goal == GoalState.STUCK:
        end = goal_end(status.goal, status.goal_reason) or name
        name, reason = end.upper(), detail_of(end, reason)
    return f"{name}: {reason}" if status.goal_reason else name
