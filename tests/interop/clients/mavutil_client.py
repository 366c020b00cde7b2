"""pymavlink's `mavutil`: a short ground station, as in many scripts."""

from collections.abc import Callable
from functools import partial
from typing import Any, NoReturn

from pymavlink import mavparm

from tests.interop.clients.pilot import GLOBAL, Pilot, Station, item, mavlink
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


class MavutilPilot(Pilot):
    """Parameters, mode and arming by the functions of mavutil and mavparm."""

    def fetch_parameters(self) -> None:
        self.link.param_fetch_all()

    def set_parameter(self, name: str, value: float) -> None:
        self.link.param_fetch_one(name)
        if not mavparm.MAVParmDict().mavset(self.link, name, value, retries=12):
            raise StepError(f"{name} was not confirmed")

    def set_mode(self, name: str) -> None:
        number = self.link.mode_mapping()[name]
        self.repeat(
            lambda: self.link.set_mode_apm(number), lambda: self.mode == name, f"mode {name}"
        )

    def arm(self) -> None:
        self.repeat(self.link.arducopter_arm, lambda: self.is_armed, "armed")


def main() -> None:
    """Run the scenario."""
    call, steps = called(), Steps("mavutil")
    run(call, steps, lambda: MavutilPilot(call.endpoint))


def run(call: Call, steps: Steps, connect: Callable[[], Station]) -> NoReturn:
    """Do all steps with the pilot that `connect` returns."""
    with steps.step("connect", is_needed=True):
        pilot = connect()
        pilot.until(lambda: pilot.newest_state is not None, "a heartbeat")
    prepare(pilot, steps, call)
    drive(pilot, steps, pilot.place)
    with steps.step("stop"):
        pilot.command(FLIGHT_TERMINATION, 1.0)
        pilot.until(lambda: pilot.is_stopped, "MAV_STATE_EMERGENCY")
        if call.transport == "tcp" and pilot.lost:
            raise StepError(f"{pilot.lost} frames are missing, and TCP loses none")
    steps.end()


def prepare(pilot: Station, steps: Steps, call: Call) -> None:
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
        pilot.set_parameter(PARAMETER, VALUE)
    with steps.step("fence"):
        corners = fence(pilot.place)
        count = float(len(corners))
        made = partial(item, command=CORNER, param1=count, mission_type=FENCE)
        pilot.upload([made(*pair) for pair in enumerate(corners)], FENCE)
    with steps.step("log"):
        path = call.folder / "downloaded.tlog"
        steps.note(f"{pilot.download_log(path)} bytes")
        call.require_recording(path)


def read_parameters(pilot: Station) -> int:
    """Fetch all parameters, and those that were lost one by one."""
    found: dict[int, str] = {}
    count = 0

    def take(message: Any) -> None:
        nonlocal count
        count = message.param_count
        if message.param_index < count:
            found[message.param_index] = message.param_id

    def ask() -> None:
        if not found:
            pilot.fetch_parameters()
            return
        for index in [one for one in range(count) if one not in found][:50]:
            pilot.mav.param_request_read_send(1, 1, b"", index)

    pilot.handlers["PARAM_VALUE"] = take
    try:
        pilot.repeat(ask, lambda: found and len(found) == count, "all parameters")
    finally:
        pilot.handlers.clear()
    if PARAMETER not in found.values():
        raise StepError(f"no {PARAMETER} among {count} parameters")
    return count


def drive(pilot: Station, steps: Steps, start: Place) -> None:
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
        # The mode that is seen may be that before the pause: a lossy line reorders.
        pilot.repeat(
            lambda: pilot.set_mode("AUTO"),
            lambda: pilot.is_at(places[-1]),
            "the last waypoint",
            50.0,
        )
    with steps.step("goto"):
        there = goal(start)
        pilot.set_mode("GUIDED")
        pilot.repeat(lambda: send_goto(pilot, there), lambda: pilot.is_at(there), "the place", 40.0)
    with steps.step("mode"):
        pilot.set_mode("HOLD")


def send_goto(pilot: Station, place: Place) -> None:
    """Send a guided goal by SET_POSITION_TARGET_GLOBAL_INT, as scripts do."""
    x, y = (round(value * 1e7) for value in place)
    ignore_all_but_place = 0xDF8
    pilot.mav.set_position_target_global_int_send(
        0, 1, 1, GLOBAL, ignore_all_but_place, x, y, *(0,) * 9
    )


if __name__ == "__main__":
    main()
