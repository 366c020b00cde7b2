"""Rows 55-57: which ground station is in control, and how control is transferred."""

from functools import wraps
from typing import Final

from vehicle_check.check import ONE_CLIENT, Check
from vehicle_check.dialect import (
    NOT_IN_CONTROL,
    REQUEST_OPERATOR_CONTROL,
    SYSTEM_MANAGER,
    TAKEOVER_ALLOWED,
    mavlink,
)  # fmt: skip
from vehicle_check.session import Client, result_name
from vehicle_check.verdict import Findings, Judge, Verdict, failed, not_applicable, row

ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
HOLD: Final = mavlink.ROVER_MODE_HOLD
RELEASE: Final = 0
REQUEST: Final = 1
TIMEOUT_S: Final = 10
STOPS: Final = (
    ("mode HOLD", mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD),
    ("193", mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0),
    ("disarming", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0),
)
"""Commands that only stop the vehicle: all but the emergency stop, which ends the row."""
ABSENT: Final = "no CONTROL_STATUS, and 32100 is UNSUPPORTED"


def ask_control(client: Client, action: int, takeover: int = 0) -> int | None:
    """Request or release control; return the result."""
    return client.result_of(
        REQUEST_OPERATOR_CONTROL, action, takeover, TIMEOUT_S, client.system, within_s=2.0
    )


def owner_becomes(check: Check, system: int) -> int | None:
    """Wait until CONTROL_STATUS names an owner; return the newest one."""
    check.main.expect_sent("CONTROL_STATUS", 2.5, lambda one: one.gcs_main == system)
    frame = check.main.latest("CONTROL_STATUS")
    return None if frame is None else int(frame.message.gcs_main)


def with_control(judge: Judge) -> Judge:
    """Judge a row unless the vehicle knows nothing of operator control, as ArduPilot 4.7."""

    @wraps(judge)
    def judged(check: Check) -> Verdict:
        if "control" not in check.facts:
            is_silent = not check.seen("CONTROL_STATUS")
            check.facts["control"] = not (
                is_silent and ask_control(check.main, RELEASE) == mavlink.MAV_RESULT_UNSUPPORTED
            )
        return judge(check) if check.facts["control"] else not_applicable(ABSENT)

    return judged


@row(
    55,
    "CONTROL_STATUS 1 Hz of the system manager, with the owner and whether takeover is allowed",
    suffers="QGroundControl: no indicator of control",
)
@with_control
def control_status(check: Check) -> Verdict:
    """Judge rate and flags."""
    if not check.seen("CONTROL_STATUS"):
        return failed("no CONTROL_STATUS")
    found = Findings()
    check.expect_rate(found, "CONTROL_STATUS", 1, 1)
    one = check.newest("CONTROL_STATUS")
    found.expect(one.flags & SYSTEM_MANAGER, f"flags {one.flags}, gcs_main {one.gcs_main}")
    found.expect(not any(one.gcs_secondary), "no secondary owners")
    return found.verdict()


@row(
    56,
    "32100: request, release, takeover; the owner is asked when takeover is not allowed",
    suffers="QGroundControl: control cannot be handed over",
)
@with_control
def handover(check: Check) -> Verdict:
    """Take control, refuse it to a second ground station, then allow it."""
    if not check.serves_two:
        return not_applicable(ONE_CLIENT)
    found, main, other = Findings(), check.main, check.second
    result = ask_control(main, REQUEST)
    if result in (None, mavlink.MAV_RESULT_UNSUPPORTED):
        return failed(f"32100: {result_name(result)}")
    owner = owner_becomes(check, main.system)
    found.expect(result == ACCEPTED and owner == main.system, f"request: owner {owner}")
    since = main.mark()
    refused = ask_control(other, REQUEST)
    found.expect(refused == mavlink.MAV_RESULT_FAILED, f"takeover: {result_name(refused)}")
    question = main.expect_sent(
        "COMMAND_LONG", 1.5, lambda one: one.command == REQUEST_OPERATOR_CONTROL, since
    )
    asked = None if question is None else round(question.message.param4)
    found.expect(asked == other.system, f"the owner is asked for {asked}")
    allowed = ask_control(main, REQUEST, takeover=1)
    status = main.expect_sent("CONTROL_STATUS", 2.0, lambda one: one.flags & TAKEOVER_ALLOWED)
    found.expect(allowed == ACCEPTED and status, f"takeover allowed: {result_name(allowed)}")
    taken = ask_control(other, REQUEST)
    owner = owner_becomes(check, other.system)
    found.expect(taken == ACCEPTED and owner == other.system, f"then: owner {owner}")
    released = ask_control(other, RELEASE)
    owner = owner_becomes(check, 0)
    found.expect(released == ACCEPTED and owner == 0, f"release: owner {owner}")
    return found.verdict()


@row(
    57,
    "commands of others are NOT_IN_CONTROL; requests that only read or stop are open to all",
    suffers="two ground stations steer one vehicle",
)
@with_control
def not_in_control(check: Check) -> Verdict:
    """Take control, and command from a second ground station."""
    if not check.serves_two:
        return not_applicable(ONE_CLIENT)
    found, main, other = Findings(), check.main, check.second
    taken = ask_control(main, REQUEST)
    if taken != ACCEPTED:
        return failed(f"32100: {result_name(taken)}")
    # Set the speed to its present value: a state-changing command that does not move the vehicle.
    speed = other.result_of(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -1, -1)
    found.expect(speed == NOT_IN_CONTROL, f"178 of another: {result_name(speed)}")
    reads = other.result_of(mavlink.MAV_CMD_REQUEST_MESSAGE, 148)
    found.expect(reads == ACCEPTED, f"512 of another: {result_name(reads)}")
    if check.options.allow_motion:
        for what, number, *params in STOPS:
            stop = other.result_of(number, *params, within_s=2.0)
            found.expect(stop == ACCEPTED, f"{what} of another: {result_name(stop)}")
        stop = other.result_of(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1, within_s=2.0)
        found.expect(stop == ACCEPTED, f"185 of another: {result_name(stop)}")
        main.result_of(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0, within_s=2.0)
    ask_control(main, RELEASE)
    owner_becomes(check, 0)
    return found.verdict()
