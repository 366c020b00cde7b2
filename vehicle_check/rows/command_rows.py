"""Rows 36, 37, 39-43, 61, 66: commands, their answers and their repetition, without motion."""

from functools import wraps
from math import nan
from typing import Final

from vehicle_check import row_steps
from vehicle_check.ground_stations import COMPONENT, RETRY_S, TRIES_WITH_LOSS, result_name
from vehicle_check.mavlink_frames import MavMessage, mavlink
from vehicle_check.row_steps import moved, place, plan_result_name, send_plan, small_mission, step_m
from vehicle_check.transfers import MISSION, PlanItem, message_of
from vehicle_check.vehicle_under_test import (
    ARDUPILOTS,
    HARSH_LOSS,
    ONE_CLIENT,
    ROVER,
    Findings,
    Judge,
    RowVerdict,
    VehicleCheck,
    failed,
    not_applicable,
    not_tried,
    row,
)

ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
DENIED: Final = mavlink.MAV_RESULT_DENIED
UNSUPPORTED: Final = mavlink.MAV_RESULT_UNSUPPORTED
REPOSITION: Final = mavlink.MAV_CMD_DO_REPOSITION
NO_COMMAND: Final = 31_998
AT_ONCE_S: Final = 0.1
REMOTE_S: Final = 0.5
"""At once over a radio or a network, where the way alone may take most of that."""
REFUSALS: Final = (DENIED, mavlink.MAV_RESULT_FAILED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
"""ArduPilot answers a restart while armed with FAILED."""
BANNER: Final = 42_428
FORCE: Final = 21_196
ARMED: Final = "the vehicle is armed: give --allow-motion"


def reposition(
    check: VehicleCheck, at: tuple[int, int], *, as_int: bool, speed: float = -1.0, flags: int = 0
) -> MavMessage:
    """Return DO_REPOSITION with a yaw of NaN, as QGroundControl sends it."""
    target = check.station.address
    if as_int:
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
        return mavlink.MAVLink_command_int_message(
            *target, frame, REPOSITION, 0, 0, speed, flags, 0, nan, *at, 0.0
        )
    return check.main.command_long(REPOSITION, speed, flags, 0, nan, at[0] / 1e7, at[1] / 1e7, 0)


def answer_to(check: VehicleCheck, message: MavMessage, number: int) -> int | None:
    """Send a command and return its result."""
    found = check.main.ask(message, "COMMAND_ACK", lambda ack: ack.command == number)
    return None if found is None else int(found.message.result)


def standing(judge: Judge) -> Judge:
    """Judge a row with the vehicle in HOLD; leave one alone that is armed by others."""

    @wraps(judge)
    def judged(check: VehicleCheck) -> RowVerdict:
        if check.is_armed and not check.options.allow_motion:
            return not_tried(ARMED)
        row_steps.stand(check)
        try:
            return judge(check)
        finally:
            row_steps.stand(check)

    return judged


@row(
    36,
    "DO_REPOSITION as INT and LONG: DENIED outside GUIDED and for 0/0, NaN yaw, never UNSUPPORTED",
    suffers="QGroundControl, MAVSDK: goto has no effect or is reported as unsupported",
    source="ArduPilot Rover/GCS_MAVLink_Rover.cpp; QGroundControl; MAVSDK",
    profiles=ROVER,
)
@standing
def goto(check: VehicleCheck) -> RowVerdict:
    """Send the command in states in which it must be denied; with motion, drive a step."""
    found = Findings()
    at = moved(place(check), step_m(check), 0.0)
    for name, is_int in (("INT", True), ("LONG", False)):
        for words, target in (("in HOLD", at), ("0/0", (0, 0))):
            flags = 0 if target == at else mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
            message = reposition(check, target, as_int=is_int, flags=flags)
            result = answer_to(check, message, REPOSITION)
            found.expect(result == DENIED, f"{name} {words}: {result_name(result)}")
    if check.options.allow_motion:
        row_steps.expect_goto(check, found, reposition)
    else:
        found.fact("driving not tried")
    return found.verdict()


@row(
    37,
    "guided item (current = 2) as ITEM and ITEM_INT is answered by MISSION_ACK",
    suffers="DroneKit simple_goto, MAVProxy, older QGroundControl",
    source="DroneKit simple_goto; MAVProxy guided; ArduPilot Rover/GCS_MAVLink_Rover.cpp",
    profiles=ROVER,
)
@standing
def guided_item(check: VehicleCheck) -> RowVerdict:
    """Send the item outside GUIDED, where it must be refused; with motion, drive a step."""
    found = Findings()
    modes = (
        (("HOLD", False), ("GUIDED", True)) if check.options.allow_motion else (("HOLD", False),)
    )
    for mode, is_moving in modes:
        if is_moving and not row_steps.start(check, mavlink.ROVER_MODE_GUIDED, found):
            break
        for as_float in (True, False):
            item = PlanItem(
                mavlink.MAV_CMD_NAV_WAYPOINT, *moved(place(check), step_m(check) / 2, 0.0)
            )
            message = message_of(check.main, item, 0, MISSION, as_float=as_float, current=2)
            ack = check.main.ask(message, "MISSION_ACK")
            result = None if ack is None else int(ack.message.type)
            is_right = result == mavlink.MAV_MISSION_ACCEPTED if is_moving else result is not None
            kind = "ITEM" if as_float else "ITEM_INT"
            found.expect(is_right, f"{kind} in {mode}: {plan_result_name(result)}")
    return found.verdict()


@row(
    39,
    "MISSION_START with 0, 0 starts; other items are denied or obeyed",
    suffers="QGroundControl, MAVSDK: mission start",
    source="QGroundControl; MAVSDK; ArduPilot GCS_MAVLink/GCS_Common.cpp",
    profiles=ROVER,
)
@standing
def mission_start(check: VehicleCheck) -> RowVerdict:
    """Start at an item after the last one; with motion, start the mission."""
    found = Findings()
    send_plan(check, small_mission(check, spread_m=step_m(check)))
    result = check.main.result_of(mavlink.MAV_CMD_MISSION_START, 98, 99)
    found.expect(result not in (None, ACCEPTED, UNSUPPORTED), f"98-99: {result_name(result)}")
    if check.options.allow_motion:
        row_steps.expect_mission(check, found, by_command=True)
    else:
        found.fact("starting not tried")
    return found.verdict()


@row(
    40,
    "arming: 21196 forces it; reasons against it as STATUSTEXT 'PreArm: ...'",
    suffers="QGroundControl shows the reasons by this prefix",
    source="QGroundControl; ArduPilot AP_Arming",
    profiles=ARDUPILOTS,
)
def arming(check: VehicleCheck) -> RowVerdict:
    """Run the checks; with motion, arm and disarm."""
    found = Findings()
    if not check.is_armed:
        since = check.main.mark()
        result = check.main.result_of(mavlink.MAV_CMD_RUN_PREARM_CHECKS)
        found.expect(result == ACCEPTED, f"401: {result_name(result)}")
        status = check.main.expect_sent("SYS_STATUS", 2.5)
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        is_healthy = status is not None and bool(
            status.message.onboard_control_sensors_health & bit
        )
        text = check.texts(since)
        fact = f"prearm {'healthy' if is_healthy else 'not healthy'}, text {text!r}"
        found.expect(is_healthy or "PreArm: " in text, fact)
    if not check.options.allow_motion:
        found.fact("arming not tried")
        return found.verdict()
    row_steps.stand(check)
    for value, name in ((1, "arm"), (0, "disarm")):
        result = check.main.result_of(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, value, FORCE)
        bit = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        check.station.wait(1.5, lambda: check.is_armed is bool(value))  # noqa: B023
        is_right = result == ACCEPTED and check.is_armed is bool(value)
        found.expect(is_right, f"{name} by force: {result_name(result)}")
    return found.verdict()


@row(
    41,
    "known commands answered, unknown ones UNSUPPORTED within 100 ms",
    suffers="every client: waits and repeats",
    source="MAVLink guide, command protocol",
)
def answers(check: VehicleCheck) -> RowVerdict:
    """Send commands that change nothing, and one that does not exist."""
    found = Findings()
    speed = mavlink.MAV_CMD_DO_CHANGE_SPEED
    calls: list[tuple[int, tuple[float, ...]]] = [
        (mavlink.MAV_CMD_REQUEST_MESSAGE, (148,)),
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (mavlink.MAVLINK_MSG_ID_VFR_HUD, 0)),
    ]
    if check.is_ardupilot:
        calls += [
            (mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, (1,)),
            (mavlink.MAV_CMD_GET_HOME_POSITION, ()),
            (mavlink.MAV_CMD_RUN_PREARM_CHECKS, ()),
        ]
    if check.is_rover and not check.is_armed:
        calls += [
            (mavlink.MAV_CMD_DO_SET_MODE, (1, check.mode)),
            (speed, (1, -1, -1)),
            (mavlink.MAV_CMD_DO_PAUSE_CONTINUE, (0,)),
        ]
    results = {number: check.main.result_of(number, *params) for number, params in calls}
    wrong = {
        number: result_name(one) for number, one in results.items() if one in (None, UNSUPPORTED)
    }
    found.expect(not wrong, f"{len(results)} known commands" + f", wrong: {wrong}" * bool(wrong))
    for _ in range(check.station.tries):
        since, stopwatch = check.main.mark(), check.station.stopwatch()
        check.main.send(check.main.command_long(NO_COMMAND))
        ack = check.main.expect_sent(
            "COMMAND_ACK", 1.0, lambda one: bool(one.command == NO_COMMAND), since
        )
        if ack is not None:
            break
    late = stopwatch.elapsed
    result = None if ack is None else int(ack.message.result)
    most_s = AT_ONCE_S if check.station.network.is_loopback else REMOTE_S
    fact = f"{NO_COMMAND}: {result_name(result)} in {1000 * late.seconds:.0f} ms"
    if found.expect(result == UNSUPPORTED, fact):
        found.expect_in_time(late, most_s, fact)
    return found.verdict()


@row(
    42,
    "42428 gives the version as STATUSTEXT; 246 is refused when armed",
    suffers="Mission Planner and MAVProxy banner; DroneKit reboot",
    source="Mission Planner; MAVProxy; DroneKit reboot",
    profiles=ARDUPILOTS,
)
def banner(check: VehicleCheck) -> RowVerdict:
    """Ask for the banner; with motion, ask an armed vehicle to restart."""
    found = Findings()
    since = check.main.mark()
    result = check.main.result_of(BANNER)
    check.station.wait(0.5)
    text = check.texts(since)
    has_version = any(one.isdigit() for one in text)
    found.expect(result == ACCEPTED and has_version, f"42428: {result_name(result)} {text!r}")
    if not check.options.allow_motion:
        found.fact("246 not tried")
    elif row_steps.start(check, mavlink.ROVER_MODE_GUIDED, found):
        restart = check.main.result_of(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
        found.expect(restart in REFUSALS, f"246 while armed: {result_name(restart)}")
        row_steps.stand(check)
        found.fact("a restart is not tried: it would end the check")
    return found.verdict()


PAIRS: Final = 20
NO_MODE: Final = 77
NO_MESSAGE: Final = 16_000_000
LAST_COPIES_S: Final = 2.0


@row(
    61,
    "an acknowledgement belongs to the command sent last, also on a line that loses frames",
    suffers="every client: it shows a command as refused that was carried out, or the reverse",
    source="MAVLink guide, command protocol",
)
@standing
def own_answers(check: VehicleCheck) -> RowVerdict:
    """Send pairs of a command that is refused and one that is not, while frames are dropped."""
    found, losses = Findings(), check.station.losses
    before, losses.share = losses.share, max(losses.share, HARSH_LOSS)
    since, delivered, wrong, refused = check.main.mark(), 0, 0, 0
    try:
        for number in range(PAIRS):
            command = mavlink.MAV_CMD_DO_SET_MODE
            pair: tuple[tuple[float, ...], tuple[float, ...]] = (1, NO_MODE), (1, check.mode)
            if number % 2 or not check.is_rover or check.is_armed:
                command, pair = mavlink.MAV_CMD_REQUEST_MESSAGE, ((NO_MESSAGE,), (148,))
            first, one = _answered(check, command, pair[0])
            second, other = _answered(check, command, pair[1])
            delivered += one + other
            refused += first not in (None, ACCEPTED)
            wrong += second != ACCEPTED
    finally:
        losses.share = before
    check.station.wait(LAST_COPIES_S)
    found.expect(refused == PAIRS, f"{refused} of {PAIRS} wrong commands refused")
    found.expect(not wrong, f"{wrong} of {PAIRS} right ones then not reported as ACCEPTED")
    commands = (mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_REQUEST_MESSAGE)
    acks = len(check.main.sent("COMMAND_ACK", since, lambda one: one.command in commands))
    found.expect(acks <= delivered, f"{acks} acknowledgements of {delivered} commands")
    return found.verdict()


def _answered(
    check: VehicleCheck, number: int, params: tuple[float, ...]
) -> tuple[int | None, int]:
    """Repeat a command until its answer arrives; return the result, and how many arrived."""
    delivered, since = 0, check.main.mark()
    for confirmation in range(TRIES_WITH_LOSS):
        message = check.main.command_long(number, *params, confirmation=confirmation)
        delivered += check.main.send(message)
        ack = check.main.expect("COMMAND_ACK", RETRY_S, lambda one: one.command == number, since)
        if ack is not None:
            return int(ack.message.result), delivered
    return None, delivered


OWN_S: Final = 1.0


@row(
    66,
    "a repeated command is ACCEPTED only while what it made holds: the mode, the arming",
    suffers="two ground stations: one shows a state that the other has ended",
    source="MAVLink guide, command protocol",
    profiles=ROVER,
)
@standing
def lapsed_answers(check: VehicleCheck) -> RowVerdict:
    """Repeat a change of mode after another client's HOLD; with motion arming after its stop."""
    if check.is_armed:
        return not_tried(ARMED)
    if not check.serves_two:
        return not_applicable(ONE_CLIENT)
    found, hold = Findings(), mavlink.ROVER_MODE_HOLD
    modes = (mavlink.ROVER_MODE_GUIDED, mavlink.ROVER_MODE_MANUAL)
    mode = next((one for one in modes if check.set_mode(one) == ACCEPTED), None)
    if mode is None:
        return failed("neither GUIDED nor MANUAL is accepted")
    stopped = check.set_mode(hold, check.second)
    check.station.wait(OWN_S, lambda: check.mode == hold)
    again = check.set_mode(mode)
    check.station.wait(OWN_S, lambda: check.mode == mode)
    fact = f"mode {mode}, HOLD of another {result_name(stopped)}, mode {mode} {result_name(again)}"
    found.expect(again != ACCEPTED or check.mode == mode, f"{fact}: mode {check.mode}")
    if check.options.allow_motion:
        _expect_no_old_arming(check, found)
    return found.verdict()


def _expect_no_old_arming(check: VehicleCheck, found: Findings) -> None:
    arm, end = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_FLIGHTTERMINATION
    armed = check.main.result_of(arm, 1, FORCE)
    check.station.wait(OWN_S, lambda: check.is_armed)
    stopped = check.second.result_of(end, 1, within_s=2.0)
    check.station.wait(OWN_S, lambda: not check.is_armed)
    again = check.main.result_of(arm, 1, FORCE)
    check.station.wait(OWN_S, lambda: check.is_armed)
    fact = f"armed {result_name(armed)}, stop of another {result_name(stopped)}"
    fact += f", armed again {result_name(again)}: armed {check.is_armed}"
    found.expect(again != ACCEPTED or check.is_armed, fact)
    check.main.result_of(end, 0, within_s=2.0)


@row(
    43,
    "one ACK for each command, to its sender; a repetition is answered and acts once",
    suffers="QGroundControl repeats commands",
    source="MAVLink guide, command protocol; QGroundControl",
)
def one_answer(check: VehicleCheck) -> RowVerdict:
    """Count the answers to a command and to its repetition."""
    found = Findings()
    number, params = BANNER, (0.0,)
    if check.is_rover and not check.is_armed:
        number = mavlink.MAV_CMD_DO_PAUSE_CONTINUE
    if not check.is_ardupilot:
        number, params = mavlink.MAV_CMD_REQUEST_MESSAGE, (148.0,)
    marks = check.main.mark(), check.second.mark()
    for _ in range(check.station.tries):
        check.main.send(check.main.command_long(number, *params))
        check.station.wait(0.7)
        acks = check.main.sent("COMMAND_ACK", marks[0], lambda ack: ack.command == number)
        if acks:
            break
    if found.expect(len(acks) == 1, f"{len(acks)} ACK"):
        one = acks[0].message
        target = one.target_system, one.target_component
        found.expect(target == (check.main.system, COMPONENT), f"ACK to {target}")
    strays = check.second.sent(
        "COMMAND_ACK",
        marks[1],
        lambda ack: ack.command == number and ack.target_system in (0, check.second.system),
    )
    found.expect(not strays, f"the other client sees {len(strays)}")
    repeated = check.main.command_long(number, *params, confirmation=1)
    ack = check.main.ask(repeated, "COMMAND_ACK", lambda one: one.command == number)
    found.expect(ack, f"confirmation 1: {'answered' if ack else 'no ACK'}")
    return found.verdict()
