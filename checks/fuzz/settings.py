"""Settings and other files: configuration, parameters, calibrations, key bindings, studies."""

import json
from argparse import Namespace
from collections.abc import Sequence
from io import BytesIO
from math import pi
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from checks.fuzz.target import FuzzTarget
from checks.fuzz.words import JSON_WORDS, TOML_WORDS, from_file, json_bombs, toml_bombs
from ground.app.input.keymap import Keymap, as_toml
from ground.app.input.keymap import load as keymap_in
from ground.client.connection import Config
from ground.client.parameter import parameters_in
from ground.client.parameter_file import read as values_in
from ground.console.history import History
from ground.ghost.branch_point import PathReader
from robot.core.parameters import DEFAULTS
from robot.parameter_table import adjusted, described
from robot.run import Settings
from robot.storage import FILE_NAME, Store
from runtime.config import FOLDER, Calibration, load_shared
from runtime.config import load as load_settings
from study.cli.calibrate import SIDE_M, from_log
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
    adjusted(DEFAULTS, load_shared(path, Settings).parameters, str(path))


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
