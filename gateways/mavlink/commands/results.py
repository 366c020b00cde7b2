"""The MAV_RESULT of each reason of the robot.

TEMPORARILY_REJECTED: a state that ends without action. FAILED: a state that the operator must end
first. DENIED: a value that is never accepted.
"""

from types import MappingProxyType
from typing import Final

from gateways.mavlink.dialect import RESULT_NOT_IN_CONTROL, mavlink
from gateways.mavlink.port import KEEPS_FENCE, NO_TELEMETRY, OVERTAKEN, Answered
from gateways.mavlink.traffic import NEWCOMER, WATCHER
from ground.client.operations import ParameterChanged
from ground.client.results import Outcome
from protocol.wire.reasons import Reason

ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
LATER: Final = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: Final = mavlink.MAV_RESULT_DENIED
UNSUPPORTED: Final = mavlink.MAV_RESULT_UNSUPPORTED
FAILED: Final = mavlink.MAV_RESULT_FAILED
UNSUPPORTED_FRAME: Final = 9
"""MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME."""

RESULTS: Final = MappingProxyType(
    {
        Reason.NONE: ACCEPTED,
        Reason.NOT_ARMED: FAILED,
        Reason.NO_SENSES: LATER,
        Reason.EMERGENCY_STOPPED: FAILED,
        Reason.GOAL_OUT_OF_RANGE: DENIED,
        Reason.TOLERANCE_OUT_OF_RANGE: DENIED,
        Reason.UNKNOWN_MODE: DENIED,
        Reason.UNKNOWN_NAVIGATOR: DENIED,
        Reason.UNKNOWN_COMMAND: UNSUPPORTED,
        Reason.UNKNOWN_PARAMETER: DENIED,
        Reason.PARAMETER_OUT_OF_RANGE: DENIED,
        Reason.NO_GOAL: FAILED,
        Reason.NO_TRAIL: FAILED,
        Reason.NO_OPERATOR: LATER,
        Reason.DRIVING: LATER,
        Reason.NOT_SAVED: FAILED,
        Reason.MALFORMED: DENIED,
        Reason.LEASE_HELD: RESULT_NOT_IN_CONTROL,
        Reason.OUTSIDE_FENCE: DENIED,
        Reason.NO_MISSION: FAILED,
        Reason.MISSION_EMPTY: DENIED,
        Reason.MISSION_ITEM_BAD: DENIED,
        Reason.MISSION_TOO_LONG: DENIED,
        Reason.HOLD_OUT_OF_RANGE: DENIED,
        Reason.UNKNOWN_FRAME: DENIED,
        Reason.FENCE_NOT_SIMPLE: DENIED,
        Reason.FENCE_LEAVES_ROBOT_OUT: DENIED,
        Reason.TOO_MANY_REQUESTS: LATER,
        Reason.ID_REUSED: LATER,
        Reason.TOO_LATE: LATER,
        Reason.TICKS_LOST: LATER,
        Reason.SCAN_LOST: LATER,
        Reason.SONAR_FROZEN: FAILED,
        Reason.SONAR_IMPOSSIBLE: FAILED,
        Reason.ENCODER_IMPOSSIBLE: FAILED,
        Reason.WHEEL_STUCK: FAILED,
        Reason.NOT_FINITE: FAILED,
        Reason.BUMPER: FAILED,
        Reason.OPERATOR_LOST: LATER,
        Reason.BUDGET: LATER,
        Reason.CORE_EXCEPTION: FAILED,
        Reason.FENCE_BREACHED: FAILED,
        Reason.NAME_TAKEN: FAILED,
        Reason.FENCE_UNCHECKED: FAILED,
        Reason.BLOCKED: FAILED,
        Reason.NO_PROGRESS: FAILED,
        Reason.UNREACHABLE: FAILED,
        Reason.BY_OPERATOR: FAILED,
        Reason.REPLACED: FAILED,
        Reason.DISARMED: FAILED,
        Reason.SHUT_DOWN: FAILED,
        Reason.BY_EMERGENCY_STOP: FAILED,
        Reason.LOST: FAILED,
        Reason.BY_HAND: FAILED,
        Reason.OBSTACLE_AHEAD: FAILED,
        Reason.SLOWED: FAILED,
        Reason.WHEEL_LIMIT: FAILED,
        Reason.FENCE_UNREADABLE: FAILED,
        Reason.NOT_WHILE_ARMED: LATER,
        Reason.LESS_SAFE_THAN_CONFIGURED: DENIED,
        Reason.NO_IDENTITY: RESULT_NOT_IN_CONTROL,
        Reason.PLACE_UNKNOWN: FAILED,
        Reason.ARMED: DENIED,
        Reason.PARAMETERS_DAMAGED: FAILED,
        Reason.NEWER_STOP: LATER,
        Reason.ALREADY_OVER: FAILED,
    }
)


def result_of(answered: Answered) -> int:
    """Return the MAV_RESULT for the end of a request; FAILED if the robot did not answer."""
    if answered.ok:
        return int(ACCEPTED)
    if answered.error in (NO_TELEMETRY, KEEPS_FENCE, OVERTAKEN):
        return int(LATER)
    if answered.error in (WATCHER, NEWCOMER) or isinstance(answered.outcome, ParameterChanged):
        return int(DENIED)
    reason = reason_of(answered.outcome)
    return int(FAILED if reason is None else RESULTS[reason])


def reason_of(outcome: Outcome | None) -> Reason | None:
    """Return the reason of a refusal.

    None if it has no reason, or one that this version does not define.
    """
    number = getattr(outcome, "reason", None)
    return Reason(number) if isinstance(number, int) and number in RESULTS else None
