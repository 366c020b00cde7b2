"""MAVSDK's package for Python: calls that block until the vehicle has answered."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.geofence import FenceType, Geofence, GeofenceData, Point, Polygon
from mavsdk.plugins.log_files import LogFiles, LogFilesResult
from mavsdk.plugins.mavlink_direct import MavlinkDirect
from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import FlightMode, Telemetry

from tests.interop.clients.steps import (
    EMERGENCY,
    LONG_S,
    PARAMETER,
    PATIENCE_S,
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

TRIES = 6
NOT_A_NUMBER = float("nan")
ACCEPTED_M = 0.1
"""MAVSDK's own choice is larger than the room."""


class Robot:
    """The plugins of one system."""

    def __init__(self, system: Any) -> None:
        self.action = Action(system)
        self.geofence = Geofence(system)
        self.log_files = LogFiles(system)
        self.mission = Mission(system)
        self.param = Param(system)
        self.telemetry = Telemetry(system)
        self.texts: list[str] = []
        self.state = 0
        self.telemetry.subscribe_status_text(lambda text, _: self.texts.append(text.text))
        self._direct = MavlinkDirect(system)
        self._direct.subscribe_message("HEARTBEAT", self._heartbeat)

    @property
    def place(self) -> Place:
        """The position of the robot."""
        found = self.telemetry.position()
        return Place(found.latitude_deg, found.longitude_deg)

    @property
    def speed_m_s(self) -> float:
        """The speed of the robot."""
        found = self.telemetry.velocity_ned()
        return float(abs(found.north_m_s) + abs(found.east_m_s))

    def call(self, call: Callable[[], Any], tries: int = TRIES) -> Any:
        """Repeat a call that fails without an answer; raise other failures."""
        for left in reversed(range(tries)):
            try:
                return call()
            except Exception as error:
                if not left or "TIMEOUT" not in str(error):
                    raise StepError(f"{error}; texts {self.texts[-4:]}") from None
        raise AssertionError

    def until(self, condition: Callable[[], object], what: str, within_s: float) -> None:
        """Wait for a condition; a failure tells what the robot shows."""
        try:
            until(condition, what, within_s)
        except StepError as error:
            mode, progress = self.telemetry.flight_mode(), self.mission.mission_progress()
            shown = f"{mode!r}, {progress}, {self.place}, texts {self.texts[-6:]}"
            raise StepError(f"{error}; {shown}") from None

    def has_mode(self, mode: FlightMode) -> bool:
        """Whether MAVSDK shows this mode."""
        return bool(self.telemetry.flight_mode() == mode)

    def _heartbeat(self, message: Any, _: object) -> None:
        words = message.fields_json.replace(" ", "")
        if message.component_id == 1:
            self.state = int(words.partition('"system_status":')[2].split(",")[0].rstrip("}"))


def main() -> None:
    """Run the scenario."""
    call, steps = called(), Steps("MAVSDK")
    kind = ComponentType.GROUND_STATION
    mavsdk = Mavsdk(Configuration.create_with_component_type(kind))
    with steps.step("connect", is_needed=True):
        mavsdk.add_any_connection(call.endpoint.replace("tcp", "tcpout").replace(":", "://", 1))
        system = mavsdk.first_autopilot(PATIENCE_S)
        if system is None:
            raise StepError(f"no autopilot within {PATIENCE_S:g} s")
        robot = Robot(system)
        until(lambda: abs(robot.place.latitude) > 0.1, "a position")
    prepare(robot, steps, call)
    drive(robot, steps)
    with steps.step("stop"):
        robot.call(robot.action.terminate)
        until(lambda: robot.state == EMERGENCY, "the state EMERGENCY")
    steps.end()


def prepare(robot: Robot, steps: Steps, call: Call) -> None:
    """Do the steps before the robot is armed."""
    with steps.step("parameters"):
        found = robot.param.get_all_params()
        names = [one.name for one in (*found.int_params, *found.float_params)]
        steps.note(f"{len(names)} parameters")
        if PARAMETER not in names:
            raise StepError(f"no {PARAMETER} among {len(names)} parameters")
    with steps.step("home"):
        until(lambda: robot.telemetry.health().is_home_position_ok, "is_home_position_ok")
        until(robot.telemetry.health_all_ok, f"health: {robot.telemetry.health()}")
    with steps.step("set_parameter"):
        robot.call(partial(robot.param.set_param_float, PARAMETER, VALUE))
        value = robot.call(partial(robot.param.get_param_float, PARAMETER))
        if value != VALUE:
            raise StepError(f"{PARAMETER} is {value}")
    with steps.step("fence"):
        corners = [Point(*place) for place in fence(robot.place)]
        data = GeofenceData([Polygon(corners, FenceType.INCLUSION)], [])
        robot.call(partial(robot.geofence.upload_geofence, data))
    with steps.step("log"):
        entries = robot.call(robot.log_files.get_entries)
        path = call.folder / "downloaded.tlog"
        robot.call(lambda: download(robot, entries[-1], path), tries=2)
        call.require_recording(path)


def drive(robot: Robot, steps: Steps) -> None:
    """Do the steps in which the robot drives."""
    start = robot.place
    places, there = route(start), goal(start)
    with steps.step("upload"):
        # An ArduPilot takes item 0 as home, and MAVSDK adds none.
        plan = MissionPlan([mission_item(place) for place in (start, *places)])
        robot.call(partial(robot.mission.upload_mission, plan))
    with steps.step("start"):
        robot.call(robot.action.arm)
        robot.call(robot.mission.start_mission)
        until(lambda: robot.place.distance_m(start) > 0.3, "30 cm of the way")
    with steps.step("pause"):
        robot.call(robot.mission.pause_mission)
        until(lambda: robot.speed_m_s < 0.01, "a standing robot")
        if robot.place.is_near(places[-1]):
            raise StepError("the mission was over before the pause")
    with steps.step("complete"):
        robot.call(robot.mission.start_mission)
        robot.until(lambda: robot.place.is_near(places[-1]), "the last waypoint", LONG_S)
        until(robot.mission.is_mission_finished, "is_mission_finished")
    with steps.step("goto"):
        go = partial(robot.action.goto_location, *there, 0.0, 90.0)
        repeat(
            lambda: robot.call(go),
            lambda: robot.place.is_near(there),
            "the place",
            every_s=15.0,
            within_s=LONG_S,
        )
    with steps.step("mode"):
        robot.call(robot.action.hold)
        until(lambda: robot.has_mode(FlightMode.HOLD), "the mode HOLD")


def mission_item(place: Place) -> MissionItem:
    """Return a waypoint without speed, gimbal, camera or yaw."""
    return MissionItem(
        latitude_deg=place.latitude,
        longitude_deg=place.longitude,
        relative_altitude_m=0.0,
        speed_m_s=NOT_A_NUMBER,
        is_fly_through=True,
        gimbal_pitch_deg=NOT_A_NUMBER,
        gimbal_yaw_deg=NOT_A_NUMBER,
        camera_action=MissionItem.CameraAction.NONE,
        loiter_time_s=NOT_A_NUMBER,
        camera_photo_interval_s=1.0,
        acceptance_radius_m=ACCEPTED_M,
        yaw_deg=NOT_A_NUMBER,
        camera_photo_distance_m=NOT_A_NUMBER,
        vehicle_action=MissionItem.VehicleAction.NONE,
    )


def download(robot: Robot, entry: Any, path: Path) -> None:
    """Download a log; MAVSDK writes no file that exists."""
    path.unlink(missing_ok=True)
    ended, results = Event(), []

    def progress(result: LogFilesResult, _data: object, _user: object) -> None:
        if result != LogFilesResult.NEXT:
            results.append(result)
            ended.set()

    robot.log_files.download_log_file_async(entry, str(path), progress)
    if not ended.wait(PATIENCE_S):
        raise StepError(f"TIMEOUT: the log has not come within {PATIENCE_S:g} s")
    if results[0] != LogFilesResult.SUCCESS:
        raise StepError(f"download: {results[0]!r}")


if __name__ == "__main__":
    main()
