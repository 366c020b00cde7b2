"""pymavlink's `mavutil`: a short ground station, as in many scripts."""

from functools import partial
from typing import Any

from pymavlink import mavparm

from tests.interop.clients.pilot import GLOBAL, Pilot, item, mavlink
from tests.interop.clients.steps import (
    FLIGHT_TERMINATION,
    PARAMETER,
    VALUE,
    Call,
    Place,
    StepError,
    Steps,
    called,
    fence,
    goal,
    route,
)

FENCE: int = mavlink.MAV_MISSION_TYPE_FENCE
CORNER: int = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION


def main() -> None:
    """Run the scenario."""
    call, steps = called(), Steps("mavutil")
    with steps.step("connect", is_needed=True):
        pilot = Pilot(f"udpout:{call.address}")
        pilot.until(lambda: pilot.newest_state is not None, "a heartbeat")
    prepare(pilot, steps, call)
    drive(pilot, steps, pilot.place)
    with steps.step("stop"):
        pilot.command(FLIGHT_TERMINATION, 1.0)
        pilot.until(lambda: pilot.is_stopped, "MAV_STATE_EMERGENCY")
    steps.end()


def prepare(pilot: Pilot, steps: Steps, call: Call) -> None:
    """Do the steps before the robot is armed."""
    with steps.step("parameters"):
        steps.note(f"{read_parameters(pilot)} parameters")
    with steps.step("home"):
        pilot.repeat(
            lambda: pilot.command(mavlink.MAV_CMD_GET_HOME_POSITION),
            lambda: "HOME_POSITION" in pilot.newest,
            "HOME_POSITION",
        )
        pilot.until(lambda: "GLOBAL_POSITION_INT" in pilot.newest, "a position")
    with steps.step("set_parameter"):
        parameters = mavparm.MAVParmDict()
        pilot.link.param_fetch_one(PARAMETER)
        if not parameters.mavset(pilot.link, PARAMETER, VALUE, retries=12):
            raise StepError(f"{PARAMETER} was not confirmed")
    with steps.step("fence"):
        corners = fence(pilot.place)
        count = float(len(corners))
        made = partial(item, command=CORNER, param1=count, mission_type=FENCE)
        pilot.upload([made(*pair) for pair in enumerate(corners)], FENCE)
    with steps.step("log"):
        path = call.folder / "downloaded.tlog"
        steps.note(f"{pilot.download_log(path)} bytes")
        call.require_recording(path)


def read_parameters(pilot: Pilot) -> int:
    """Fetch all parameters as mavutil does, and those that were lost one by one."""
    found: dict[int, str] = {}
    count = 0

    def take(message: Any) -> None:
        nonlocal count
        count = message.param_count
        if message.param_index < count:
            found[message.param_index] = message.param_id

    def ask() -> None:
        if not found:
            pilot.link.param_fetch_all()
            return
        for index in [one for one in range(count) if one not in found][:50]:
            pilot.link.mav.param_request_read_send(1, 1, b"", index)

    pilot.handlers["PARAM_VALUE"] = take
    try:
        pilot.repeat(ask, lambda: found and len(found) == count, "all parameters")
    finally:
        pilot.handlers.clear()
    if PARAMETER not in found.values():
        raise StepError(f"no {PARAMETER} among {count} parameters")
    return count


def drive(pilot: Pilot, steps: Steps, start: Place) -> None:
    """Do the steps in which the robot drives."""
    places = route(start)
    with steps.step("upload"):
        home = item(0, start)
        pilot.upload([home, *(item(seq, place) for seq, place in enumerate(places, 1))], 0)
    with steps.step("start"):
        pilot.arm()
        pilot.set_mode("AUTO")
        pilot.until(lambda: pilot.place.distance_m(start) > 0.3, "30 cm of the way")
    with steps.step("pause"):
        pilot.set_mode("HOLD")
        pilot.until(lambda: pilot.speed_m_s < 0.01, "a standing robot")
        if pilot.is_at(places[-1]):
            raise StepError("the mission was over before the pause")
    with steps.step("complete"):
        pilot.set_mode("AUTO")
        pilot.until(lambda: pilot.is_at(places[-1]), "the last waypoint", 50.0)
    with steps.step("goto"):
        there = goal(start)
        pilot.set_mode("GUIDED")
        pilot.repeat(lambda: send_goto(pilot, there), lambda: pilot.is_at(there), "the place", 40.0)
    with steps.step("mode"):
        pilot.set_mode("HOLD")


def send_goto(pilot: Pilot, place: Place) -> None:
    """Send a guided goal by SET_POSITION_TARGET_GLOBAL_INT, as scripts do."""
    x, y = (round(value * 1e7) for value in place)
    ignore_all_but_place = 0xDF8
    pilot.link.mav.set_position_target_global_int_send(
        0, 1, 1, GLOBAL, ignore_all_but_place, x, y, *(0,) * 9
    )


if __name__ == "__main__":
    main()
