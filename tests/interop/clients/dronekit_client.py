"""DroneKit 2.9.2, with the shim that it needs from Python 3.10 on.

It has no calls for fences and logs: such scripts send the messages themselves.
"""

import collections
import collections.abc
from collections.abc import Callable
from functools import partial
from typing import Any

collections.MutableMapping = collections.abc.MutableMapping  # type: ignore[attr-defined]

from dronekit import (  # noqa: E402
    Command,
    LocationGlobalRelative,
    VehicleMode,
    connect,
)

from tests.interop.clients.pilot import Station, item, mavlink  # noqa: E402
from tests.interop.clients.steps import (  # noqa: E402  # noqa: E402
    FLIGHT_TERMINATION,
    LONG_S,
    PARAMETER,
    VALUE,
    Call,
    Place,
    StepError,
    Steps,
    called,
    fence,
    goal,
    repeat,
    route,
    until,
)

FENCE: int = mavlink.MAV_MISSION_TYPE_FENCE
CORNER: int = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
FRAME: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
CALL_S = 2
"""A call of the library without retries is repeated after this time."""
CALLS = 30


class DroneKitStation(Station):
    """The messages that a vehicle of DroneKit passes on."""

    def __init__(self, vehicle: Any) -> None:
        super().__init__()
        self.vehicle = vehicle
        self.mav = vehicle.message_factory
        vehicle.add_message_listener("*", lambda _self, _name, message: self.take(message))


def patient(call: Callable[[], object], what: str) -> None:
    """Repeat a call that raises TimeoutError, a limited number of times."""
    for _ in range(CALLS):
        try:
            call()
        except TimeoutError:
            continue
        except Exception as error:  # DroneKit has a TimeoutError of its own
            if type(error).__name__ != "TimeoutError":
                raise
            continue
        return
    raise StepError(f"{what}: {CALLS} times without an answer for {CALL_S} s")


def main() -> None:
    """Run the scenario."""
    call, steps = called(), Steps("DroneKit")
    with steps.step("connect", is_needed=True):
        vehicle = connect(call.endpoint, wait_ready=False, heartbeat_timeout=60)
        station = DroneKitStation(vehicle)
    prepare(station, steps, call)
    drive(station, steps)
    with steps.step("stop"):
        station.command(FLIGHT_TERMINATION, 1.0)
        until(lambda: vehicle.system_status.state == "EMERGENCY", "the state EMERGENCY")
    vehicle.close()
    steps.end()


def prepare(station: DroneKitStation, steps: Steps, call: Call) -> None:
    """Do the steps before the robot is armed."""
    vehicle = station.vehicle
    with steps.step("parameters"):
        vehicle.wait_ready("parameters", "gps_0", "armed", "mode", "attitude", timeout=LONG_S)
        steps.note(f"{len(vehicle.parameters)} parameters")
        until(lambda: vehicle.is_armable, "is_armable")
    with steps.step("home"):
        patient(partial(download, vehicle), "the mission, whose item 0 is home")
        if not vehicle.home_location:
            raise StepError("no home location after a download of the mission")
    with steps.step("set_parameter"):
        if not vehicle.parameters.set(PARAMETER, VALUE, retries=12, wait_ready=True):
            raise StepError(f"{PARAMETER} was not confirmed")
        until(lambda: vehicle.parameters[PARAMETER] == VALUE, f"{PARAMETER} = {VALUE}")
    with steps.step("fence"):
        corners = fence(place_of(vehicle))
        made = partial(item, command=CORNER, param1=float(len(corners)), mission_type=FENCE)
        station.upload([made(*pair) for pair in enumerate(corners)], FENCE)
    with steps.step("log"):
        path = call.folder / "downloaded.tlog"
        steps.note(f"{station.download_log(path)} bytes")
        call.require_recording(path)


def drive(station: DroneKitStation, steps: Steps) -> None:
    """Do the steps in which the robot drives; DroneKit sends places as 32-bit floats."""
    vehicle = station.vehicle
    start = place_of(vehicle)
    places = [place.rounded() for place in route(start)]
    there = goal(start).rounded()
    with steps.step("upload"):
        upload_whole(vehicle, places, steps)
    with steps.step("start"):
        repeat(partial(setattr, vehicle, "armed", True), lambda: vehicle.armed, "armed")
        set_mode(vehicle, "AUTO")
        until(lambda: place_of(vehicle).distance_m(start) > 0.3, "30 cm of the way")
    with steps.step("pause"):
        set_mode(vehicle, "HOLD")
        until(lambda: vehicle.groundspeed < 0.01, "a standing robot")
        if place_of(vehicle).is_near(places[-1]):
            raise StepError("the mission was over before the pause")
    with steps.step("complete"):
        set_mode(vehicle, "AUTO")
        until(lambda: place_of(vehicle).is_near(places[-1]), "the last waypoint", LONG_S)
    with steps.step("goto"):
        set_mode(vehicle, "GUIDED")
        go = partial(vehicle.simple_goto, LocationGlobalRelative(*there, 0.0))
        repeat(
            go, lambda: place_of(vehicle).is_near(there), "the place", every_s=5.0, within_s=LONG_S
        )
    with steps.step("mode"):
        set_mode(vehicle, "HOLD")


def place_of(vehicle: Any) -> Place:
    """Return where the vehicle is."""
    frame = vehicle.location.global_relative_frame
    return Place(frame.lat, frame.lon)


def set_mode(vehicle: Any, name: str) -> None:
    """Set the mode until the vehicle has it."""
    repeat(
        partial(setattr, vehicle, "mode", VehicleMode(name)),
        lambda: vehicle.mode.name == name,
        f"mode {name}",
    )


def download(vehicle: Any) -> None:
    """Download the mission."""
    vehicle._ready_attrs.add("commands")  # an attempt that timed out has removed it
    vehicle.commands.download()
    vehicle.commands.wait_ready(timeout=CALL_S)


def upload_whole(vehicle: Any, places: list[Place], steps: Steps) -> None:
    """Upload until it reads back: DroneKit does not notice that its last item was lost."""
    for tries in range(1, CALLS):
        patient(partial(upload, vehicle, places), "the upload")
        patient(partial(download, vehicle), "the mission")
        if vehicle.commands.count == len(places):
            steps.note(f"{tries} uploads")
            return
    raise StepError(f"the robot has {vehicle.commands.count} of {len(places)} items")


def upload(vehicle: Any, places: list[Place]) -> None:
    """Upload a mission; DroneKit adds home as item 0."""
    commands = vehicle.commands
    commands.clear()
    for place in places:
        numbers = (0, 0, 0, FRAME, mavlink.MAV_CMD_NAV_WAYPOINT, 0, 0, 0, 0, 0, 0)
        commands.add(Command(*numbers, *place, 0))
    commands.upload(timeout=CALL_S)


if __name__ == "__main__":
    main()
