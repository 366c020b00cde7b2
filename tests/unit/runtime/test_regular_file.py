"""No file that a user names holds up a process or fills its memory: it is named in an error."""

import os
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp

import pytest

from ground.app.input import keymap
from ground.certificates.folder import read as read_certificate
from ground.client import parameter_file
from ground.client.connection import Config
from ground.console.history import History
from ground.missions import files as mission_files
from ground.recording.catalogue import remark_on
from ground.recording.log_reader import open_log
from ground.user.settings import load_settings, set_setting
from ground.web import token_of
from plant.imports.ros_map import load_map_yaml
from plant.model.errors import WorldError
from plant.world.file import load as load_world
from protocol.bus.certificate import own_certificate
from protocol.bus.network import Tls
from runtime import config, files
from runtime.errors import UserError
from study.calibration import read_log as read_calibration
from study.falsify.findings import read_finding as read_finding
from study.runner.store import settings_in
from tests.support.each import each
from vehicle_check.mavlink_frames import read_key

GB: int = 1 << 30


def large(path: Path) -> None:
    """Make a file of 1 GB, which takes no room."""
    path.touch()
    os.truncate(path, GB)


def link(target: str) -> Callable[[Path], None]:
    return lambda path: path.symlink_to(target)


MADE: dict[str, Callable[[Path], object]] = {
    "a pipe": os.mkfifo,
    "a device": link("/dev/zero"),
    "a directory": Path.mkdir,
    "1 GB": large,
}


def missions(path: Path) -> None:
    mission_files.read(path)


def recording(path: Path) -> None:
    remark_on(path, None)
    next(iter(open_log(path)))


def settings(path: Path) -> None:
    load_settings()


def setting(path: Path) -> None:
    set_setting("bell", "false")


READERS: dict[str, Callable[[Path], object]] = {
    "config.toml": settings,
    "./config.toml": setting,
    "robot.toml": lambda path: config.load_shared(path, Config),
    "keys.toml": keymap.load,
    "params.toml": lambda path: parameter_file.read(path, ()),
    "mission.toml": missions,
    "mission.plan": missions,
    "mission.waypoints": missions,
    "world.toml": load_world,
    "map.yaml": load_map_yaml,
    "run": recording,
    "key": read_key,
    "token": lambda path: token_of(str(path)),
    "robot.pem": read_certificate,
    "ca.pem": lambda path: own_certificate(Tls(ca=str(path), certificate=str(path), key=str(path))),
    "square.csv": read_calibration,
    "finding.toml": read_finding,
    "settings.json": settings_in,
}


@each("kind", [*MADE])
@each("name", [*READERS])
def test_a_file_that_is_none_is_named_at_once(
    name: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = Path(mkdtemp(dir=tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
    path = home / "sidestep" / name
    path.parent.mkdir()
    MADE[kind](path)
    with pytest.raises((UserError, WorldError)) as refused:
        READERS[name](path)
    text = str(refused.value)
    assert path.name in text
    assert "Errno" not in text
    assert text.count("\n") == 0


@each("kind", [*MADE])
def test_history_that_is_none_is_left_alone(kind: str, tmp_path: Path) -> None:
    path = Path(mkdtemp(dir=tmp_path)) / "history"
    MADE[kind](path)
    assert "history: " in History(path).trouble


@each("suffix", [".tlog", ".mcap"])
def test_pipe_with_the_name_of_a_recording_is_named(suffix: str, tmp_path: Path) -> None:
    path = Path(mkdtemp(dir=tmp_path)) / f"run{suffix}"
    os.mkfifo(path)
    with pytest.raises(UserError, match="not a regular file: name a recording"):
        recording(path)


def test_text_has_newlines_as_line_ends(tmp_path: Path) -> None:
    (tmp_path / "text").write_bytes(b"a\r\nb\n")
    assert files.text_in(tmp_path / "text", 5) == "a\nb\n"
    with pytest.raises(files.UnusableFileError, match=r"^larger than 4 bytes$"):
        files.text_in(tmp_path / "text", 4)
