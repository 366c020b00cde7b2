"""Missions and fences, in the project's files and in those of QGroundControl."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from checks.fuzz.target import FuzzTarget
from checks.fuzz.words import JSON_WORDS, TOML_WORDS, from_file, json_bombs, toml_bombs
from ground.missions import files, qgroundcontrol
from ground.missions import files as toml_file
from ground.missions.mission import Circle, Home, Mission, Polygon, Waypoint
from ground.missions.transfer import fence_items_of, items_of
from protocol.wire.codec import Encoder
from protocol.wire.messages import MissionItemInt

HOME: Final = Home(latitude_deg=48.1, longitude_deg=11.5)
WAYPOINTS: Final = (
    Waypoint(x_m=2.0, y_m=1.0, heading_deg=90.0),
    Waypoint(x_m=1.0, y_m=-2.0, hold_s=3.0, position_tolerance_m=0.2),
)
AROUND: Final = ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))
MISSIONS: Final = (
    Mission(waypoints=WAYPOINTS, fence=Circle(x_m=0.0, y_m=0.0, radius_m=9.0), home=HOME),
    Mission(waypoints=WAYPOINTS, fence=Polygon(corners=AROUND), home=HOME),
)


def texts(text_of: Callable[[Mission], str]) -> Callable[[], Sequence[bytes]]:
    """Return samples in a file format."""
    return lambda: [text_of(one).encode() for one in MISSIONS]


def read_mission(path: Path) -> None:
    """Read a mission, send it, and write it in every format."""
    found = files.read(path).mission
    str(found)
    send(items_of(found.waypoints))
    if found.fence is not None:
        send(fence_items_of(found.fence))
    for ending in files.ENDINGS:
        if found.home is not None or ending == ".toml":
            files.write(path.with_name(f"again{ending}"), found)


def read_fence(path: Path) -> None:
    """Read a fence and send it."""
    send(fence_items_of(files.read_fence(path)))


def send(items: Sequence[MissionItemInt]) -> None:
    """Encode items as frames; values that do not fit must have been refused before."""
    for item in items:
        Encoder(255, 190).encode(item)


def plan_bombs() -> Sequence[bytes]:
    """Return plans with far too many corners or items."""
    corner = b"[48.1, 11.5],[48.2, 11.5],[48.2, 11.6],"
    home = (
        b'{"fileType": "Plan", "mission": {"plannedHomePosition": [48.1, 11.5, 0], "items": [%s]},'
    )
    fence = b'"geoFence": {"polygons": [{"inclusion": true, "polygon": [%s[48,11]]}]}}'
    many = home % (b"{}," * 100_000 + b"{}") + fence % corner
    return [*json_bombs(), home % b"" + fence % (corner * 5_000), many]


MISSION: Final = (
    FuzzTarget(
        name="mission_toml",
        samples=texts(toml_file.toml_text),
        run=from_file("mission.toml", read_mission),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
    FuzzTarget(
        name="mission_plan",
        samples=texts(lambda one: qgroundcontrol.plan_text(one, HOME)),
        run=from_file("mission.plan", read_mission),
        words=JSON_WORDS,
        bombs=plan_bombs,
    ),
    FuzzTarget(
        name="mission_waypoints",
        samples=texts(lambda one: qgroundcontrol.waypoints_text(one, HOME)),
        run=from_file("mission.waypoints", read_mission),
        words=(b"\t", b"\n", b"QGC WPL 110\n", b"nan", b"1e308"),
    ),
    FuzzTarget(
        name="fence",
        samples=texts(toml_file.toml_text),
        run=from_file("fence.toml", read_fence),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
)
