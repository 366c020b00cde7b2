"""The recording of a session is looked after by its file alone: it grows, or the alarm is loud."""

import os
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from ground.cli.main import parse
from ground.client.connection import Common
from ground.launch.recording_session import Recording, folder_of, usual_folder
from protocol.bus.network import Network
from runtime.clock import ManualClock
from runtime.errors import UserError

S = 1_000_000_000
COMMON = Common(network=Network(mode="client", connect=("tcp/127.0.0.1:1",)), robot="r1")


class Session:
    """Half a second at a time; the file grows if the test says so."""

    def __init__(self, folder: Path) -> None:
        self.clock = ManualClock()
        self.recording = Recording(folder, COMMON, self.clock, None)
        self.log = folder / "20260304T120005Z-r1.tlog"
        self.told: list[str] = []

    def goes_on(self, seconds: float, *, grows: bool = True, heard: bool = True) -> None:
        for _ in range(round(seconds * 2)):
            self.clock.advance(S // 2)
            if grows:
                with self.log.open("ab") as file:
                    file.write(b"frame")
            self.told += self.recording.poll(heard=heard)


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(tmp_path)


def test_while_the_file_grows_all_is_well(session: Session) -> None:
    session.recording.watch(set())
    session.goes_on(10.0)
    assert (session.recording.words, session.told) == ("REC", [])
    assert session.recording.file == session.log


def test_a_file_that_stops_growing_is_told_loudly_and_once(session: Session) -> None:
    session.recording.watch(set())
    session.goes_on(5.0)
    session.goes_on(10.0, grows=False)
    assert session.recording.words == "REC!"
    (told,) = session.told
    assert told.startswith("RECORDING HAS STOPPED: nothing was written to ")
    assert told.endswith("the robot drives on")
    session.goes_on(2.0)
    assert session.recording.words == "REC"
    assert session.told[1:] == ["RECORDING goes on"]


def test_a_full_disk_is_named(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    full: Callable[[Path], object] = lambda _: SimpleNamespace(f_bavail=3, f_frsize=4096)  # noqa: E731
    monkeypatch.setattr(os, "statvfs", full)
    session.recording.watch(set())
    session.goes_on(5.0, grows=False)
    assert "the disk is full" in session.told[0]


def test_a_folder_that_is_gone_is_named(tmp_path: Path) -> None:
    session = Session(tmp_path / "gone")
    session.recording.watch(set())
    session.goes_on(5.0, grows=False)
    assert "No such file or directory" in session.told[0]


def test_a_silent_robot_is_no_trouble_of_the_recorder(session: Session) -> None:
    session.recording.watch(set())
    session.goes_on(30.0, grows=False, heard=False)
    assert (session.recording.words, session.told) == ("REC", [])
    session.goes_on(5.0, grows=False)
    session.goes_on(5.0, grows=False, heard=False)
    assert session.recording.words == "REC!", "a silence mends nothing"


def test_another_robots_file_and_an_old_one_do_not_count(session: Session, tmp_path: Path) -> None:
    old = tmp_path / "20260101T000000Z-r1.tlog"
    for path in (old, tmp_path / "20270101T000000Z-r2.tlog"):
        path.write_bytes(b"frame")
    session.recording.watch({old})
    assert session.recording.file is None


def test_without_a_recorder_it_says_nothing(session: Session) -> None:
    session.goes_on(10.0, grows=False)
    assert (session.recording.words, session.told) == ("", [])
    with pytest.raises(UserError, match="nothing is being recorded here"):
        session.recording.end()


def test_it_is_on_unless_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert usual_folder() == tmp_path / "sidestep" / "recordings"
    for verb in ("up", "ground"):
        assert folder_of(options(verb)) == usual_folder()
        assert folder_of(options(verb, "--record", "here")) == Path("here")
        assert folder_of(options(verb, "--no-record")) is None
        with pytest.raises(SystemExit):
            options(verb, "--no-record", "--record", "here")


def options(*words: str) -> Namespace:
    found: Namespace = parse(words)
    return found


def test_beginning_one_deletes_the_oldest_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = tmp_path / "20260101T000000Z-r1.tlog"
    old.write_bytes(b"x" * 2_000_000)
    clock = ManualClock()
    recording = Recording(tmp_path, COMMON, clock, None, keep="1MB")
    started: list[list[str]] = []
    monkeypatch.setattr(recording._children, "start", lambda _role, words: started.append(words))
    recording.begin()
    assert not old.exists()
    assert started[0][-2:] == ["--keep", "1MB"]
    assert "deleted the oldest recording in" in " ".join(recording.poll(heard=True))
    assert recording.poll(heard=True) == []


def test_a_bound_that_cannot_be_read_is_refused_before_anything_is_started(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="write it as 2GB or 500MB"):
        Recording(tmp_path, COMMON, ManualClock(), None, keep="lots").begin()
    assert list(tmp_path.iterdir()) == []
