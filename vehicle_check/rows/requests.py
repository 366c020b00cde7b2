"""Rows 14, 25, 48: origin, modes and clocks on request."""

from functools import partial
from typing import Any, Final

from vehicle_check.check import Check
from vehicle_check.dialect import TIMESYNC, ExtraMessage, mavlink
from vehicle_check.rows import driving
from vehicle_check.session import COMPONENT, result_name
from vehicle_check.verdict import Findings, Verdict, failed, row

ORIGIN: Final = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
REQUEST_MESSAGE: Final = mavlink.MAV_CMD_REQUEST_MESSAGE
AVAILABLE_MODES: Final = 435
CURRENT_MODE: Final = 436
MODES_S: Final = 2.0
MOVED_E7: Final = 10_000
"""About 100 m."""
STAMP_NS: Final = 1_234_567_890_123


@row(
    14,
    "GPS_GLOBAL_ORIGIN on request 49 and after SET_GPS_GLOBAL_ORIGIN",
    suffers="mavros, MAVSDK; ArduPilot ignores local setpoints without an origin",
)
def origin(check: Check) -> Verdict:
    """Request the origin, and set it to its present value."""
    found = Findings()
    answer = check.main.request(ORIGIN, "GPS_GLOBAL_ORIGIN")
    if answer is None:
        return failed("512/49: no GPS_GLOBAL_ORIGIN")
    one = answer.message
    found.fact(f"origin {one.latitude} {one.longitude}")
    again = mavlink.MAVLink_set_gps_global_origin_message(
        check.target, one.latitude, one.longitude, one.altitude
    )
    echo = check.main.ask(again, "GPS_GLOBAL_ORIGIN")
    found.expect(echo, f"SET_GPS_GLOBAL_ORIGIN: {'echoed' if echo else 'no GPS_GLOBAL_ORIGIN'}")
    if echo is not None:
        is_same = (echo.message.latitude, echo.message.longitude) == (one.latitude, one.longitude)
        found.expect(is_same, f"echo {echo.message.latitude} {echo.message.longitude}")
    if check.options.allow_motion and driving.start(check, driving.GUIDED, found):
        _expect_fixed_origin(check, found, one)
        driving.stand(check)
    return found.verdict()


def _expect_fixed_origin(check: Check, found: Findings, one: Any) -> None:
    """Try to move the origin of an armed vehicle."""
    moved = mavlink.MAVLink_set_gps_global_origin_message(
        check.target, one.latitude + MOVED_E7, one.longitude, one.altitude
    )
    check.main.send_surely(moved)
    check.station.wait(0.5)
    now = check.main.request(ORIGIN, "GPS_GLOBAL_ORIGIN")
    is_fixed = now is not None and now.message.latitude == one.latitude
    found.expect(is_fixed, f"moved while armed: {'refused' if is_fixed else 'taken'}")
    if now is not None and not is_fixed:
        again = mavlink.MAVLink_set_gps_global_origin_message(
            check.target, one.latitude, one.longitude, one.altitude
        )
        check.main.ask(again, "GPS_GLOBAL_ORIGIN")


@row(
    25,
    "AVAILABLE_MODES and CURRENT_MODE, or UNSUPPORTED at once",
    suffers="QGroundControl: waits while connecting",
)
def modes(check: Check) -> Verdict:
    """Ask for all modes and for the present one."""
    found, since = Findings(), check.main.mark()
    for number, name in ((AVAILABLE_MODES, "AVAILABLE_MODES"), (CURRENT_MODE, "CURRENT_MODE")):
        result = check.main.result_of(REQUEST_MESSAGE, number)
        found.expect(result is not None, f"{name}: {result_name(result)}")
        if result != mavlink.MAV_RESULT_ACCEPTED:
            continue
        if number == AVAILABLE_MODES:
            _expect_modes(check, found, since)
        else:
            heard = check.main.heard(name, since)
            current = heard[-1] if heard else check.main.request(number, name)
            mode = None if current is None else current.message.custom_mode
            found.expect(mode == check.mode, f"CURRENT_MODE {mode}, HEARTBEAT {check.mode}")
    return found.verdict()


def _is_index(index: int, one: Any) -> bool:
    return bool(one.mode_index == index)


def _expect_modes(check: Check, found: Findings, since: int) -> None:
    """Expect all modes; ask again for those that were lost, as QGroundControl does."""
    name, listed = "AVAILABLE_MODES", dict[int, Any]()

    def take() -> bool:
        frames = check.main.heard(name, since)
        listed.update({one.message.mode_index: one.message for one in frames})
        return bool(listed) and len(listed) >= next(iter(listed.values())).number_modes

    if not check.station.wait(MODES_S, take) and check.station.is_lossy:
        count = next(iter(listed.values())).number_modes if listed else 1
        for index in range(1, count + 1):
            if index not in listed:
                asked = check.main.command_long(REQUEST_MESSAGE, AVAILABLE_MODES, index)
                check.main.ask(asked, name, partial(_is_index, index))
        take()
    count = next(iter(listed.values())).number_modes if listed else 0
    names = [one.mode_name.decode("utf-8", "replace") for one in listed.values()]
    found.expect(listed and len(listed) == count, f"{len(listed)} of {count} modes: {names}")


@row(
    48,
    "TIMESYNC and PING answered to their sender; SYSTEM_TIME 1 Hz",
    suffers="mavros, MAVSDK: no common time",
)
def clocks(check: Check) -> Verdict:
    """Send TIMESYNC with a target, and PING."""
    found = Findings()
    target = {"target_system": check.target, "target_component": 1}
    answer = check.main.ask(
        ExtraMessage(TIMESYNC, ts1=STAMP_NS, **target), "TIMESYNC", lambda one: one.tc1 != 0
    )
    if found.expect(answer, f"TIMESYNC: {'answered' if answer else 'no answer'}") and answer:
        one = answer.message
        found.expect(one.ts1 == STAMP_NS, f"ts1 {one.ts1}")
        echoed = one.target_system, one.target_component
        found.expect(echoed == (check.main.system, COMPONENT), f"TIMESYNC target {echoed}")
    ping = mavlink.MAVLink_ping_message(STAMP_NS // 1000, 7, 0, 0)
    pong = check.main.ask(ping, "PING", lambda one: one.seq == 7)
    got = (pong.message.target_system, pong.message.target_component) if pong else None
    found.expect(got == (check.main.system, COMPONENT), f"PING answered to {got}")
    check.expect_rate(found, "SYSTEM_TIME", 1, 1)
    return found.verdict()
