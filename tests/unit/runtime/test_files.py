"""Files: replaced whole, and never one that holds up a process."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import pytest

from checks.harness.reordering_disk import ReorderingDisk, content_of
from ground.app.input import keymap
from ground.certificates import read as read_certificate
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

HOME = Path("/state")
FILE = HOME / "fence.json"


class FileHistory:
    """The contents of a file in order, each acknowledged before the next."""

    def __init__(self, disk: Any, path: Path = FILE) -> None:
        self.disk = disk
        self.path = path
        self.problems: list[str] = []
        self._now: str | None = None

    def put(self, text: str | None) -> None:
        """Replace or remove the file, and check every power cut up to the answer and after it."""
        before, begun = self._now, len(self.disk.cuts)
        if text is None:
            files.remove(self.path)
        else:
            files.make_folder(self.path.parent)
            files.replace(self.path, text)
        self._now = text
        for states in self.disk.cuts[begun:]:
            self._look(states, {before, text}, "before the answer")
        self._look(self.disk.cuts[-1], {text}, "after the answer")

    def _look(self, states: frozenset[Any], allowed: set[str | None], when: str) -> None:
        for state in states:
            found = content_of(state, self.path)
            text = None if found is None else found.decode(errors="replace")
            if text not in allowed:
                self.problems.append(f"{when}: {text!r}, not {allowed}")


def contents_of(disk: Any, path: Path = FILE) -> list[str]:
    """Return the states of a file over its whole life."""
    story = FileHistory(disk, path)
    for text in ("first", "second, longer", "x", None, "again", None, None, "", "the last"):
        story.put(text)
    return story.problems


def test_every_power_cut_leaves_the_old_content_or_the_new(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    disk = ReorderingDisk()
    monkeypatch.setattr(files, "os", disk)
    assert contents_of(disk) == []
    assert len(disk.cuts) > 30
    assert max(len(states) for states in disk.cuts) > 5, "a cut in between has several outcomes"


def test_a_folder_that_was_made_survives_with_its_file(monkeypatch: pytest.MonkeyPatch) -> None:
    disk = ReorderingDisk()
    monkeypatch.setattr(files, "os", disk)
    assert contents_of(disk, HOME / "of" / "r1" / "fence.json") == []


class WithoutFileSync(ReorderingDisk):
    def fsync(self, handle: int) -> None:
        if self.isdir_open(handle):
            super().fsync(handle)


class WithoutFolderSync(ReorderingDisk):
    def fsync(self, handle: int) -> None:
        if not self.isdir_open(handle):
            super().fsync(handle)


class WithoutRename(ReorderingDisk):
    """Imitates a program that writes a file in place."""

    def replace(self, old: Path, new: Path) -> None:
        content = self.content(old)
        self.unlink(old)
        handle = self.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        self.write(handle, content)
        self.fsync(handle)
        self.close(handle)


@pytest.mark.parametrize("kind", [WithoutFileSync, WithoutFolderSync, WithoutRename])
def test_a_missing_step_is_found_by_the_simulated_cut(
    kind: type[ReorderingDisk], monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = kind()
    monkeypatch.setattr(files, "os", disk)
    assert contents_of(disk) != []


@pytest.mark.parametrize("act", [lambda path: files.replace(path, "b"), files.remove])
@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC])
def test_a_directory_that_cannot_be_synchronised_is_an_error(
    act: Callable[[Path], None], number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("a")
    fail_for_folders(monkeypatch, number)
    with pytest.raises(OSError, match="as contents_of"):
        act(tmp_path / "file")


def test_file_system_without_directory_sync_is_usable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fail_for_folders(monkeypatch, errno.EINVAL)
    files.replace(tmp_path / "file", "b")
    assert (tmp_path / "file").read_text() == "b"


def fail_for_folders(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    fsync = os.fsync

    def failing(handle: int) -> None:
        if Path(f"/proc/self/fd/{handle}").resolve().is_dir():
            raise OSError(number, "as contents_of")
        fsync(handle)

    monkeypatch.setattr("os.fsync", failing)


def test_removing_a_missing_file_is_no_error(tmp_path: Path) -> None:
    files.remove(tmp_path / "file")
    files.remove(tmp_path / "no folder" / "file")
    assert list(tmp_path.iterdir()) == []


def test_a_draft_left_by_a_killed_process_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / ".file.part").write_text("half of somethi")
    files.replace(tmp_path / "file", "whole")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "whole"


def test_a_write_that_takes_less_than_it_was_given_is_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write
    monkeypatch.setattr("os.write", lambda number, data: write(number, data[:3]))
    files.replace(tmp_path / "file", "longer than three")
    assert (tmp_path / "file").read_text() == "longer than three"


def test_link_to_a_file_keeps_its_target(tmp_path: Path) -> None:
    (tmp_path / "target").write_text("a")
    for name in ("target", "missing"):
        (tmp_path / f"to {name}").symlink_to(tmp_path / name)
        files.replace(tmp_path / f"to {name}", "b")
        assert (tmp_path / f"to {name}").is_symlink()
        assert (tmp_path / name).read_text() == "b"


def test_link_to_a_device_is_replaced_and_not_the_device(tmp_path: Path) -> None:
    """A pipe stands for it: as root, the link to a device would have replaced it for all."""
    os.mkfifo(tmp_path / "device")
    (tmp_path / "parameters.json").symlink_to(tmp_path / "device")
    files.replace(tmp_path / "parameters.json", "b")
    assert (tmp_path / "device").is_fifo()
    assert not (tmp_path / "parameters.json").is_symlink()
    assert (tmp_path / "parameters.json").read_text() == "b"


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


def write_half(path: Path) -> None:
    with files.drafted(path) as draft:
        draft.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device", str(draft))


def test_draft_replaces_the_file_only_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("before")
    with pytest.raises(OSError, match="No space left") as caught:
        write_half(path)
    assert caught.value.filename == str(path)
    assert [one.name for one in tmp_path.iterdir()] == ["table.csv"]
    assert path.read_text() == "before"
    with files.drafted(path) as draft:
        draft.write_text("whole")
    assert path.read_text() == "whole"


def test_draft_of_a_device_is_the_device_itself() -> None:
    with files.drafted(Path("/dev/null")) as draft:
        assert draft == Path("/dev/null")


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


def test_text_has_no_mark_and_newlines_as_line_ends(tmp_path: Path) -> None:
    (tmp_path / "text").write_bytes(b"\xef\xbb\xbfa\r\nb\n")
    assert files.text_in(tmp_path / "text", 8) == "a\nb\n"
    (tmp_path / "text").write_bytes(b"a\r\nb\n")
    assert files.text_in(tmp_path / "text", 5) == "a\nb\n"
    with pytest.raises(files.UnusableFileError, match=r"^larger than 4 bytes$"):
        files.text_in(tmp_path / "text", 4)
