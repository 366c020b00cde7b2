"""Decoders of files and of typed input to fuzz.

Files are settings, studies, keys, missions, fences, worlds and maps. Typed are console lines,
command lines, endpoints and the requests of browsers.
"""

import json
import shlex
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from functools import cache
from io import BytesIO
from math import pi
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from checks.fuzz.target import (
    JSON_WORDS,
    REFUSALS,
    TOML_WORDS,
    FuzzTarget,
    from_file,
    json_bombs,
    toml_bombs,
)
from gateways.mavlink.signing import StampClock
from ground.app.input.keymap import Keymap, as_toml
from ground.app.input.keymap import load as keymap_in
from ground.branch_point import PathReader
from ground.certificates import check, make
from ground.cli.main import OPERATOR_VERBS
from ground.client.connection import Config
from ground.client.parameter import parameters_in
from ground.client.parameter_file import read as values_in
from ground.commands.fence import outlined
from ground.console.completion import complete
from ground.console.history import History
from ground.console.parser import read
from ground.missions import files, qgroundcontrol
from ground.missions.mission import Circle, Home, Mission, Polygon, Waypoint
from ground.missions.transfer import fence_items_of, items_of
from ground.user.folders import PRIVATE_FILE
from ground.user.mavlink_keys import KeyRing, new_key, read_keys, write_keys
from ground.web import address_of, token_of
from ground.web_server import WebAccess
from plant.imports.importer import ImportOptions, import_worlds
from plant.process import parser as plant_parser
from plant.world.file import SHIPPED_DIR, loads
from plant.world.file import load as load_world
from plant.world.writer import dumps
from protocol.bus.certificate import own_certificate
from protocol.bus.network import Network, Tls
from protocol.options import numbers_kept
from protocol.topics import robot_name
from protocol.wire.codec import Encoder
from protocol.wire.messages import MissionItemInt
from protocol.world import as_json
from robot.core.parameters import DEFAULTS
from robot.parameter_table import adjusted, described
from robot.run import RobotSettings
from robot.run import parser as robot_parser
from robot.storage import FILE_NAME, Store
from runtime.cli.parsers import parser_of
from runtime.config import FOLDER, Calibration, load_shared
from runtime.config import load as load_settings
from study.cli.calibrate import SIDE_M, from_log
from study.cli.calibrate import parser as calibrate_parser
from study.runner.store import FILE as SETTLED
from study.runner.store import RESULTS, SCHEMA, differences, find, settings_in

CHUNK: Final = 97
STEPS: Final = 20
SHORT_M: Final = 0.4
SETTINGS: Final = b"""robot = "r1"
[network]
mode = "client"
listen = ["tcp/127.0.0.1:7447"]
connect = ["tcp/[::1]:7447", "unixsock-stream//tmp/x"]
prefix = "sidestep"
connect_timeout_s = 2.5
[parameters]
d_obs_m = 0.4
navigator = 2
"""
GHOST: Final = (
    b"tick,true_x_m,true_y_m\n0,1.0,2.0\n1,1.1,2.0\n"
    b'{"outcome": "reached", "reason": "ok", "time_s": 3.5, "path_m": 1.1, "contacts": 0}\n'
)
LOCKED: Final = b"""[network]
listen = ["tls/localhost:7447"]
robots = ["r1", "r2"]
[network.tls]
ca = "ca.pem"
certificate = "robot-r1.pem"
key = "robot-r1.key"
[network.trouble]
loss = 0.1
delay_ms = 20
jitter_ms = 5
duplicate = 0.01
reorder = 0.02
paths = ["sense"]
seed = 7
"""
WANTED: Final = {"worlds": {"box": "1"}, "code": "2", "seeds": 3}


def settings(path: Path) -> None:
    """Read a settings file and its parameters."""
    load_shared(path, Config)
    adjusted(DEFAULTS, load_shared(path, RobotSettings).parameters, str(path))


def calibration(path: Path) -> None:
    """Read a calibration and its parameters."""
    adjusted(DEFAULTS, load_settings(path, Calibration).parameters, str(path))


def runs(path: Path) -> None:
    """Calibrate from a log of squares."""
    from_log(Namespace(log=str(path), side=SIDE_M), DEFAULTS).as_json()


def driven() -> Sequence[bytes]:
    """Return a log of squares in both directions, with steps and final poses."""
    lines = ["run,direction,left,right,x_m,y_m,heading_deg"]
    side = SHORT_M / DEFAULTS.m_per_tick / STEPS
    corner = DEFAULTS.track_m * pi / 4.0 / DEFAULTS.m_per_tick / STEPS
    for run, turn in enumerate((-1, -1, 1, 1)):
        left = right = 0.0
        direction = "cw" if turn < 0 else "ccw"
        for step in range(8 * STEPS + 1):
            end = f"0.00{run},0.00{run},0.1{run}" if step == 8 * STEPS else ",,"
            lines.append(f"{run},{direction},{round(left)},{round(right)},{end}")
            straight = step // STEPS % 2 == 0
            left += side if straight else -turn * corner
            right += side if straight else turn * corner
    return ["\n".join(lines).encode()]


def study_settings(path: Path) -> None:
    """Compare the settings of a study."""
    differences(settings_in(path) or {}, WANTED)


def course(data: bytes, _: Path) -> None:
    """Read the output of a ghost process in chunks."""
    reading = PathReader()
    for at in range(0, len(data), CHUNK):
        reading.take(data[at : at + CHUNK])
    reading.course("no output")


OWN_LIST: Final = json.dumps(described(DEFAULTS))


def tables() -> Sequence[bytes]:
    """Return files without rows, and with two rows, compressed and not."""
    columns = {one.name: pa.array(["1", "1"]).cast(one.type) for one in SCHEMA}
    two = pa.table(columns, schema=SCHEMA)
    return [written(SCHEMA.empty_table(), "NONE"), written(two, "NONE"), written(two, "zstd")]


def written(table: pa.Table, compression: str) -> bytes:
    """Return a table as a Parquet file."""
    out = BytesIO()
    pq.write_table(table, out, compression=compression)
    return out.getvalue()


def read_rows(data: bytes, folder: Path) -> None:
    """Read the rows of a study."""
    (folder / RESULTS).write_bytes(data)
    find(folder)


SETTING: Final = (
    FuzzTarget(
        name="settings",
        samples=lambda: [SETTINGS, LOCKED],
        run=from_file("sidestep.toml", settings),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
    FuzzTarget(
        name="parameter_file",
        samples=lambda: [b"[parameters]\nd_obs_m = 0.4\nside = -1\n"],
        run=from_file("own.toml", lambda path: values_in(path, parameters_in(OWN_LIST))),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
    FuzzTarget(
        name="stored_parameters",
        samples=lambda: [b'{"d_obs_m": 0.4, "side": -1}', b'[["d_obs_m", 0.4]]'],
        run=from_file(FILE_NAME, lambda path: Store(path.parent).load(DEFAULTS)),
        allowed=(),
        words=JSON_WORDS,
        bombs=json_bombs,
    ),
    FuzzTarget(
        name="calibration",
        samples=lambda: [path.read_bytes() for path in sorted(FOLDER.glob("*.toml"))],
        run=from_file("level.toml", calibration),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
    FuzzTarget(
        name="calibration_log",
        samples=driven,
        run=from_file("runs.csv", runs),
        words=(b",", b"\n", b'"', b"cw", b"ccw", b"nan", b"inf"),
    ),
    FuzzTarget(
        name="keys",
        samples=lambda: [as_toml(Keymap()).encode(), b'[keys]\nhold = ["h", "f3"]\n'],
        run=from_file("keys.toml", keymap_in),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
    FuzzTarget(
        name="history",
        samples=lambda: [b"goto 1 2\nparam set d_obs_m 0.4\n"],
        run=from_file("history", lambda path: History(path).previous("")),
        allowed=(),
    ),
    FuzzTarget(
        name="study_settings",
        samples=lambda: [b'{"seeds": 2, "worlds": {"box": "1"}, "code": "3", "commit": "4"}'],
        run=from_file(SETTLED, study_settings),
        words=JSON_WORDS,
        bombs=json_bombs,
    ),
    FuzzTarget(
        name="ghost_output",
        samples=lambda: [GHOST],
        run=course,
        allowed=(),
        words=(*JSON_WORDS, b'"contacts": ', b'"time_s": '),
        bombs=json_bombs,
    ),
    FuzzTarget(name="study_rows", samples=tables, run=read_rows, words=(b"PAR1",), weight=8),
)


SINCE: Final = datetime(2026, 1, 1, tzinfo=UTC)
NOW: Final = SINCE + timedelta(days=10)
UNTIL: Final = SINCE + timedelta(days=10_000)
NAME: Final = "robot-r1"
WORDS: Final = (b"-----BEGIN CERTIFICATE-----\n", b"-----END CERTIFICATE-----\n", b"\n", b"=")


@cache
def good() -> dict[str, bytes]:
    """Return the files of a complete set, by name."""
    with TemporaryDirectory() as parent:
        folder = Path(parent) / "keys"
        make(folder, ["r1"], {}, SINCE, UNTIL)
        return {path.name: path.read_bytes() for path in folder.iterdir()}


def check_among_good(ending: str, data: bytes, folder: Path) -> None:
    """Check a set in which one file has other content."""
    for name, content in good().items():
        if name == "ca.pem" or name.startswith(NAME):
            (folder / name).write_bytes(content)
    (folder / f"{NAME}{ending}").write_bytes(data)
    (folder / f"{NAME}.key").chmod(PRIVATE_FILE)
    check(folder, NOW)
    ca, certificate, key = (folder / one for one in ("ca.pem", f"{NAME}.pem", f"{NAME}.key"))
    own_certificate(Tls(ca=str(ca), certificate=str(certificate), key=str(key)))


def signing_keys() -> list[bytes]:
    """Return the files of one key and of two."""
    found = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "keys.toml"
        for number in (1, 2):
            write_keys(path, KeyRing(key=tuple(new_key() for _ in range(number))))
            found.append(path.read_bytes())
    return found


def read_signing_keys(data: bytes, folder: Path) -> None:
    """Read a file of signing keys."""
    path = folder / "signing.toml"
    path.write_bytes(data)
    path.chmod(PRIVATE_FILE)
    read_keys(path)


def read_stamp(data: bytes, folder: Path) -> None:
    """Read the newest time stamp of a signature, and give the next one."""
    path = folder / "stamp"
    path.write_bytes(data)
    StampClock(lambda: 1, path).next().to_bytes(6, "little")


KEYS: Final = (
    FuzzTarget(name="signing_keys", samples=signing_keys, run=read_signing_keys, weight=8),
    FuzzTarget(name="signing_stamp", samples=lambda: [b"123456789\n"], run=read_stamp, weight=4),
    FuzzTarget(
        name="certificate",
        samples=lambda: [good()[f"{NAME}.pem"]],
        run=lambda data, folder: check_among_good(".pem", data, folder),
        words=WORDS,
        weight=8,
    ),
    FuzzTarget(
        name="private_key",
        samples=lambda: [good()[f"{NAME}.key"]],
        run=lambda data, folder: check_among_good(".key", data, folder),
        words=WORDS,
        weight=8,
    ),
)


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
        samples=texts(files.toml_text),
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
        samples=texts(files.toml_text),
        run=from_file("fence.toml", read_fence),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
)


SMALL_BYTES: Final = 6000
FEW_OBSTACLES: Final = 50
MAP_WORDS: Final = (b"@", b".", b"T", b"\n", b" ", b"\t", b"type octile\n", b"height ", b"map\n")
YAML_WORDS: Final = (b": ", b"- ", b"[", b"]", b"\n", b"image: ", b"'", b'"', b"#", b"---\n")
ROS_YAML: Final = b"""image: map.pgm
resolution: 0.25
origin: [0.0, -1.0, 0.1]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
PGM: Final = b"P5\n# made\n24 16\n255\n" + (b"\xfe" * 23 + b"\0") * 8 + b"\xfe" * 24 * 8
PGM_AS_TEXT: Final = b"P2 24 16 255\n" + b" ".join([b"254"] * 300 + [b"0"] * 84)
OCTILE: Final = b"type octile\nheight 12\nwidth 16\nmap\n" + b"\n".join([b"." * 11 + b"@@T.."] * 12)
SCENARIO: Final = b"version 1\n0\tworld.map\t16\t12\t1\t1\t9\t8\t11.2\n"
CYLINDERS: Final = b"x_m,y_m,radius\n1.5, 0.3, 0.075\n2.0 1.1\n# no more\n3.1;0.2;0.3\n"


def shipped() -> Sequence[bytes]:
    """Return some shipped worlds."""
    names = ("box", "moving", "u_trap", "paper_fig5", "corner")
    return [(SHIPPED_DIR / f"{name}.toml").read_bytes() for name in names]


def as_texts() -> Sequence[bytes]:
    """Return worlds as JSON."""
    return [
        json.dumps(as_json(load_world(name), None)).encode() for name in ("box", "moving", "door")
    ]


def read_world(path: Path) -> None:
    """Read a world and write it; a small one must read back as the same world."""
    found = load_world(path)
    text = dumps(found)
    if len(found.obstacles) < FEW_OBSTACLES and dumps(loads(text)) != text:
        raise AssertionError("the written world differs from the one that was read")


def import_all(path: Path) -> object:
    """Import the worlds of a file; only a part of a large file."""
    small = path.stat().st_size <= SMALL_BYTES
    return list(import_worlds(path, ImportOptions() if small else ImportOptions(window=20)))


def beside(name: str, data: bytes) -> Callable[[Path], object]:
    """Return an importer of a file that refers to another one, which is good."""

    def read(path: Path) -> object:
        (path.parent / name).write_bytes(data)
        return import_all(path)

    return read


def picture(path: Path) -> object:
    """Import a picture with the settings of a ROS map."""
    settings = path.with_name("map.yaml")
    settings.write_bytes(ROS_YAML)
    return import_all(settings)


def grids() -> Sequence[bytes]:
    """Return good NumPy files."""
    found = []
    for made in (np.eye(12, dtype=np.uint8), np.zeros((8, 9)), np.asfortranarray(np.eye(7) > 0)):
        np.save(out := BytesIO(), made)
        found.append(out.getvalue())
    return found


def map_bombs() -> Sequence[bytes]:
    """Return maps that announce too much, or data that is missing."""
    huge = b"{'descr': '<f8', 'fortran_order': False, 'shape': (900000000, 9)}"
    return [
        b"type octile\nheight 4096\nwidth 4096\nmap\n" + b"." * 4096,
        b"type octile\nheight 900000000\nwidth 900000000\nmap\n",
        b"P5 20000 20000 255\n" + b"\0" * 1000,
        b"P2 20000 20000 65535\n" + b"1 " * 100_000,
        b"\x93NUMPY\x01\0" + len(huge).to_bytes(2, "little") + huge,
        b"\x93NUMPY\x01\0\x10\x27" + b"(" * 10_000,
        b"1 1 1e-9\n" * 50_000,
    ]


WORLDS: Final = (
    FuzzTarget(
        name="world",
        samples=shipped,
        run=from_file("world.toml", read_world),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
    FuzzTarget(
        name="world_json",
        samples=as_texts,
        run=from_file("world.json", read_world),
        words=JSON_WORDS,
        bombs=json_bombs,
    ),
    FuzzTarget(
        name="moving_ai",
        samples=lambda: [OCTILE],
        run=from_file("world.map", import_all),
        words=MAP_WORDS,
        bombs=map_bombs,
    ),
    FuzzTarget(
        name="scenarios",
        samples=lambda: [SCENARIO],
        run=from_file("world.scen", beside("world.map", OCTILE)),
        words=MAP_WORDS,
    ),
    FuzzTarget(
        name="ros_map",
        samples=lambda: [ROS_YAML],
        run=from_file("map.yaml", beside("map.pgm", PGM)),
        words=YAML_WORDS,
    ),
    FuzzTarget(
        name="picture",
        samples=lambda: [PGM, PGM_AS_TEXT],
        run=from_file("map.pgm", picture),
        words=(b"P5 ", b"P2 ", b"#", b"\n", b" ", b"65535 "),
        bombs=map_bombs,
    ),
    FuzzTarget(
        name="barn_grid",
        samples=grids,
        run=from_file("grid.npy", import_all),
        words=(b"(", b")", b"'descr'", b"'<f8'", b"'|O'", b"True", b"\x93NUMPY"),
        bombs=map_bombs,
    ),
    FuzzTarget(
        name="barn_list",
        samples=lambda: [CYLINDERS],
        run=from_file("list.csv", import_all),
        bombs=map_bombs,
    ),
)


TOKEN: Final = "0123456789abcdefgh"
SESSION: Final = "abcdefgh0123456789"
LINES: Final = (
    *("goto 5.4 2 -90", "param set d_obs_m 0.4", "mission upload 'my file.toml'", "teleop 0.2 30"),
    *("fence polygon 0 0 4 0 4 4", "mode manual", "export run.mcap --shape wide --out x.csv"),
    *("lease take", "replay run.tlog", "explain --turns run.mcap", "help goto", "find arm"),
)
TYPED_WORDS: Final = (
    *(
        *(b"'", b'"', b"\\", b" -- ", b" --json", b" --at ", b" -1e3", b" nan", b" inf", b"="),
        *(b"@", b"%"),
    ),
    *(
        *(b" --id ", b" --config ", b"goto ", b"param ", b"mission ", b"~", b"/"),
        *(b"\xe2\x80\xae", b"\0"),
    ),
)
COMMAND_LINES: Final = (
    b"robot\0--id\0r1\0--listen\0tcp/127.0.0.1:7447\0--start\x000\x000\x0090\0--param\0d_obs_m=0.4",
    b"plant\0--world\0box\0--robots\0r1,r2\0--seed\x007\0--noise\0lossy\0--speed\x0010",
    b"calibrate\0--runs\x005\0--side\x004\0--plot\0x.svg",
    b"goto\x001\x002\0-90\0--json",
    b"up\0--world\0box\0--goal\x001\x002\0--robots\x003\0--speed\0max\0--headless",
    b"export\0run.mcap\0--rate\x0010\0--from\x00-1",
)
PARSERS: Final[dict[str, Callable[[], ArgumentParser]]] = {
    "robot": robot_parser,
    "plant": plant_parser,
    "calibrate": calibrate_parser,
}
REQUESTS: Final = (
    f"/?token={TOKEN}\n".encode(),
    f"/ws?width=80\nCookie: sidestep_8765={SESSION}\nOrigin: http://127.0.0.1:8765\n".encode(),
    b"/static/js/textual.js\nCookie: sidestep_8765=wrong\nHost: [::1]:8765\n",
    b"/?token=%ff%fe\nOrigin: http://[\nCookie: a=b; sidestep_8765=\n",
)


def text_of(data: bytes) -> str:
    """Decode terminal input as Python does."""
    return data.decode("utf-8", "surrogateescape")


def console(data: bytes, folder: Path) -> None:
    """Complete and parse a console line."""
    text = text_of(data)
    for line in complete(text, ("d_obs_m", "side"), folder)[:3]:
        shlex.split(line)
    read(text)


def command_line(data: bytes, _: Path) -> None:
    """Parse arguments that are separated by zero bytes."""
    word, *rest = text_of(data).split("\0")
    if word in PARSERS:
        PARSERS[word]().parse_args(numbers_kept(rest))
    elif word in OPERATOR_VERBS:
        parser_of(word).parse_args(numbers_kept(rest))


def endpoint(data: bytes, _: Path) -> None:
    """Read an endpoint and a robot name."""
    first, second = text_of(data).partition("\n")[::2]
    robot_name(second or "r1")
    Network(mode="client", connect=(first,), prefix=second or "sidestep")


def address(data: bytes, _: Path) -> None:
    """Read a web address."""
    address_of(text_of(data)).url(TOKEN)


def token(path: Path) -> None:
    """Read a token file."""
    token_of(str(path))


def fence_words(data: bytes, _: Path) -> None:
    """Read the words of a fence."""
    outlined(text_of(data).split())


def door(data: bytes, _: Path) -> None:
    """Check a web request (first line: path, then headers): access needs the token."""
    first, *lines = data.decode("latin-1").split("\n")
    pairs = (line.partition(":")[::2] for line in lines if ":" in line)
    headers = {name.strip(): value.strip() for name, value in pairs if name.strip()}
    try:
        request = make_mocked_request("GET", first or "/", headers=headers)
    except ValueError:  # refused before it gets here
        return
    inside: list[web.Request] = []

    async def handler(asked: web.Request) -> web.Response:
        inside.append(asked)
        return web.Response(text="in")

    access = WebAccess(TOKEN, 8765)
    access.sessions.append(SESSION)
    answer = finished(access.middleware()(request, handler))
    if inside and SESSION not in headers.get("Cookie", request.headers.get("Cookie", "")):
        raise AssertionError("a request without the token was admitted")
    if answer.status not in (200, 303, 403):
        raise AssertionError(f"unexpected HTTP status {answer.status}")


def finished(waiting: object) -> web.StreamResponse:
    """Return the result of a coroutine that does not wait."""
    try:
        waiting.send(None)  # type: ignore[attr-defined]
    except StopIteration as done:
        found: web.StreamResponse = done.value
        return found
    raise AssertionError("the web access check must not wait")


def lines() -> Sequence[bytes]:
    """Return good console lines."""
    return [line.encode() for line in LINES]


TYPED: Final = (
    FuzzTarget(name="console", samples=lines, run=console, words=TYPED_WORDS),
    FuzzTarget(
        name="command_line",
        samples=lambda: COMMAND_LINES,
        run=command_line,
        allowed=(*REFUSALS, SystemExit),
        words=(*TYPED_WORDS, b"\0--", b"\0"),
    ),
    FuzzTarget(
        name="endpoint",
        samples=lambda: [b"tcp/127.0.0.1:7447\nr1", b"udp/[::1]:0#a=b", b"unixsock-stream//tmp/x"],
        run=endpoint,
        words=(b"/", b":", b"[", b"]", b"#", b"?", b"udp/", b"\n", b"**"),
    ),
    FuzzTarget(
        name="web_address",
        samples=lambda: [b"127.0.0.1:8765", b"[::1]:80", b"8080", b"localhost"],
        run=address,
        words=(b":", b"[", b"]", b"\xd9\xa1", b"\xc2\xb2"),
    ),
    FuzzTarget(name="token", samples=lambda: [TOKEN.encode()], run=from_file("token", token)),
    FuzzTarget(name="fence_words", samples=lambda: [b"0 0 4 0 4 4 0 4"], run=fence_words),
    FuzzTarget(
        name="door",
        samples=lambda: REQUESTS,
        run=door,
        allowed=(),
        words=(b"token=", b"%", b"%c3%28", b"Origin: ", b"Cookie: ", b"Host: ", b"\n", b"=", b";"),
    ),
)
