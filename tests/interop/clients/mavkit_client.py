"""MavKit 0.3: a library in Rust with calls for Python that end when the vehicle has answered.

It has no calls for logs.
"""

import asyncio
import os
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from typing import Any, Final

from mavkit import (
    HomePosition,
    MavkitError,
    MissionFrame,
    MissionItem,
    MissionPlan,
    MissionType,
    SystemStatus,
    Vehicle,
)

from tests.interop.clients.steps import (
    FLIGHT_TERMINATION,
    LONG_S,
    PARAMETER,
    VALUE,
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

WAYPOINT: Final = 16
CORNER: Final = 5001
TRIES: Final = 6
CALL_S: Final = 15.0
"""After this time the user cancels a call, and repeats it."""


class Robot:
    """A vehicle of MavKit, whose threads follow it between two calls."""

    def __init__(self, address: str) -> None:
        self._loop = asyncio.new_event_loop()
        self.vehicle = self._loop.run_until_complete(connected(address))

    def call(self, call: Callable[[], Coroutine[Any, Any, Any]], tries: int = TRIES) -> Any:
        """Repeat a call that fails without an answer, or does not end; raise other failures."""
        for left in reversed(range(tries)):
            try:
                return self._loop.run_until_complete(self._awaited(call))
            except (MavkitError, TimeoutError) as error:
                is_silent = isinstance(error, TimeoutError) or "timed out" in str(error)
                if not left or not is_silent:
                    raise StepError(f"{error!r}; {self.seen()}") from None
        raise AssertionError

    async def _awaited(self, call: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
        return await asyncio.wait_for(call(), CALL_S)

    def seen(self) -> str:
        """Return what MavKit shows, for the message of a failure."""
        state, text = self.vehicle.state, self.vehicle.statustext
        return f"mode {state.mode_name}, armed {state.armed}, newest text {text and text.text!r}"

    def until(self, condition: Callable[[], object], what: str, within_s: float = LONG_S) -> None:
        """Wait for a condition; a failure tells what the robot shows."""
        try:
            until(condition, what, within_s)
        except StepError as error:
            raise StepError(f"{error}; {self.seen()}") from None

    @property
    def place(self) -> Place:
        """The position of the robot."""
        found = self.vehicle.position
        return Place(found.latitude_deg or 0.0, found.longitude_deg or 0.0)

    def set_mode(self, name: str) -> None:
        """Set the mode until the vehicle shows it."""
        self.call(partial(self.vehicle.set_mode_by_name, name))
        self.until(lambda: self.vehicle.state.mode_name == name, f"mode {name}")


async def connected(address: str) -> Vehicle:
    """Return a vehicle; MavKit begins only in a running event loop."""
    return await Vehicle.connect(address)


def main() -> None:
    """Run the scenario."""
    call, steps = called(), Steps("MavKit")
    with steps.step("connect", is_needed=True):
        robot = Robot(call.endpoint.replace("tcp", "tcpout"))
        robot.until(lambda: abs(robot.place.latitude) > 0.1, "a position")
    prepare(robot, steps)
    drive(robot, steps)
    with steps.step("stop"):
        robot.call(partial(robot.vehicle.command_long, FLIGHT_TERMINATION, 1.0))
        robot.until(
            lambda: robot.vehicle.state.system_status == SystemStatus.Emergency, "the emergency"
        )
    try:
        steps.end()
    except SystemExit as end:
        os._exit(int(end.code or 0))  # its threads may abort while Python ends


def prepare(robot: Robot, steps: Steps) -> None:
    """Do the steps before the robot is armed."""
    vehicle = robot.vehicle
    with steps.step("parameters"):
        store = robot.call(vehicle.download_params)
        steps.note(f"{len(store)} of {store.expected_count} parameters")
        if len(store) != store.expected_count or PARAMETER not in store:
            raise StepError(f"{len(store)} of {store.expected_count} parameters")
    with steps.step("home"):
        robot.until(lambda: vehicle.home_position is not None, "the home position")
    with steps.step("set_parameter"):
        written = robot.call(partial(vehicle.write_param, PARAMETER, VALUE))
        if written.value != VALUE:
            raise StepError(f"{PARAMETER} is {written.value}")
    with steps.step("fence"):
        corners = fence(robot.place)
        upload(robot, MissionType.Fence, CORNER, corners, param1=float(len(corners)))


def drive(robot: Robot, steps: Steps) -> None:
    """Do the steps in which the robot drives."""
    vehicle, start = robot.vehicle, robot.place
    places, there = route(start), goal(start)
    with steps.step("upload"):
        plan = upload(
            robot,
            MissionType.Mission,
            WAYPOINT,
            places,
            home=HomePosition(latitude_deg=start.latitude, longitude_deg=start.longitude),
        )
        found = robot.call(partial(vehicle.download_mission, MissionType.Mission))
        if list(map(content, found.items)) != list(map(content, plan.items)):
            raise StepError("the mission reads back changed")
    with steps.step("start"):
        robot.call(partial(vehicle.arm, False))
        robot.set_mode("AUTO")
        robot.until(lambda: robot.place.distance_m(start) > 0.3, "30 cm of the way")
    with steps.step("pause"):
        robot.set_mode("HOLD")
        robot.until(lambda: (vehicle.position.speed_mps or 0.0) < 0.01, "a standing robot")
        if robot.place.is_near(places[-1]):
            raise StepError("the mission was over before the pause")
    with steps.step("complete"):
        robot.set_mode("AUTO")
        robot.until(lambda: robot.place.is_near(places[-1]), "the last waypoint")
    with steps.step("goto"):
        robot.set_mode("GUIDED")
        repeat(
            lambda: robot.call(partial(vehicle.goto, *there, 0.0)),
            lambda: robot.place.is_near(there),
            "the place",
            every_s=15.0,
            within_s=LONG_S,
        )
    with steps.step("mode"):
        robot.set_mode("HOLD")


def content(one: MissionItem) -> tuple[object, ...]:
    """Return what has to read back as it was sent; MavKit marks one as the current item itself."""
    params = one.param1, one.param2, one.param3, one.param4
    return one.seq, one.command, one.x, one.y, one.z, *params


def upload(
    robot: Robot,
    kind: MissionType,
    command: int,
    places: Sequence[Place],
    *,
    param1: float = 0.0,
    home: HomePosition | None = None,
) -> MissionPlan:
    """Upload items at places; return the plan."""
    items = [
        MissionItem(
            seq=seq,
            command=command,
            frame=MissionFrame.GlobalRelativeAltInt,
            x=round(place.latitude * 1e7),
            y=round(place.longitude * 1e7),
            param1=param1,
        )
        for seq, place in enumerate(places)
    ]
    plan = MissionPlan(mission_type=kind, items=items, home=home)
    robot.call(partial(robot.vehicle.upload_mission, plan))
    return plan


if __name__ == "__main__":
    main()
