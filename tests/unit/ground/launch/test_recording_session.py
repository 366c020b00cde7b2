"""The supervision of a recording by its file, and which files belong to a run."""

import os
from argparse import Namespace
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from ground.cli.main import parse
from ground.client.connection import Common
from ground.launch.recording_session import RecorderFiles, RecordingSession, folder_of
from ground.user.folders import recordings_folder
from protocol.bus.network import Network
from runtime.clock import ManualClock
from runtime.errors import UserError
from runtime.units import NS_PER_S as S
from tests.support.ground.made_recordings import PrintingChildren, printing_children

FOLDER = Path("a folder of r1 and .mcap")
FIRST, SECOND = (FOLDER / f"20261123T10000{second}Z-r1.tlog" for second in (1, 2))


@pytest.fixture
def children() -> Iterator[PrintingChildren]:
    with printing_children() as found:
        yield found


def test_files_of_all_recorders_are_known_after_a_restart(children: PrintingChildren) -> None:
    files = RecorderFiles()
    children.start("robot r1", [])
    children.print_name(SECOND)
    children.start("recorder r1", [])
    files.update(children, FOLDER)
    assert (files.all, files.newest("r1")) == ([], None), "it has printed nothing yet"
    children.print_name(FIRST, before="only 0.5 GB free\n")
    files.update(children, FOLDER)
    assert files.newest("r1") == FIRST
    children.stop()
    children.start("recorder r1", [])
    files.update(children, FOLDER)
    assert files.newest("r1") == FIRST, "until the new recorder has created its own"
    children.print_name(SECOND)
    files.update(children, FOLDER)
    assert (files.newest("r1"), files.all) == (SECOND, [FIRST, SECOND])


def test_each_robot_has_its_own_file(children: PrintingChildren) -> None:
    files = RecorderFiles()
    arm = FOLDER / "20261123T100001Z-left-arm.1.tlog"
    for log in (FIRST, arm):
        children.start("recorder", [])
        children.print_name(log)
    files.update(children, FOLDER)
    assert (files.newest("left-arm"), files.newest("r1"), files.newest("r2")) == (arm, FIRST, None)


def test_output_that_another_thread_has_closed_is_no_error(children: PrintingChildren) -> None:
    files = RecorderFiles()
    children.start("recorder r1", [])
    children.print_name(FIRST)
    children.snapshot()[0].output.close()
    files.update(children, FOLDER)
    assert files.all == []


COMMON = Common(network=Network(mode="client", connect=("tcp/127.0.0.1:1",)), robot="r1")


class Session:
    """Steps half a second at a time; the file grows if `grows` is set."""

    def __init__(self, folder: Path) -> None:
        self.clock = ManualClock()
        self.recording = RecordingSession(folder, COMMON, self.clock, None)
        self.log = folder / "20260304T120005Z-r1.tlog"
        self.messages: list[str] = []

    def newest(self) -> Path | None:
        return self.log if self.log.exists() else None

    def run(self, seconds: float, *, grows: bool = True, is_receiving: bool = True) -> None:
        for _ in range(round(seconds * 2)):
            self.clock.advance(S // 2)
            if grows:
                with self.log.open("ab") as file:
                    file.write(b"frame")
            self.messages += self.recording.poll(is_receiving=is_receiving)


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(tmp_path)


def test_growing_file_raises_no_alarm(session: Session) -> None:
    session.recording.watch(session.newest)
    session.run(10.0)
    assert (session.recording.words, session.messages) == ("REC", [])
    assert session.recording.file == session.log


def test_stalled_file_raises_one_alarm(session: Session) -> None:
    session.recording.watch(session.newest)
    session.run(5.0)
    session.run(10.0, grows=False)
    assert session.recording.words == "REC!"
    (message,) = session.messages
    assert message.startswith("RECORDING HAS STOPPED: nothing was written to ")
    assert message.endswith("the robot drives on")
    session.run(2.0)
    assert session.recording.words == "REC"
    assert session.messages[1:] == ["RECORDING resumed"]


def test_alarm_names_a_full_disk(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    full: Callable[[Path], object] = lambda _: SimpleNamespace(f_bavail=3, f_frsize=4096)  # noqa: E731
    monkeypatch.setattr(os, "statvfs", full)
    session.recording.watch(session.newest)
    session.run(5.0, grows=False)
    assert "the disk is full" in session.messages[0]


def test_alarm_names_a_missing_folder(tmp_path: Path) -> None:
    session = Session(tmp_path / "gone")
    session.recording.watch(session.newest)
    session.run(5.0, grows=False)
    assert "No such file or directory" in session.messages[0]


def test_silent_robot_raises_no_alarm(session: Session) -> None:
    session.recording.watch(session.newest)
    session.run(30.0, grows=False, is_receiving=False)
    assert (session.recording.words, session.messages) == ("REC", [])
    session.run(5.0, grows=False)
    session.run(5.0, grows=False, is_receiving=False)
    assert session.recording.words == "REC!", "a silent robot does not clear the alarm"


def test_newer_file_of_another_run_in_the_folder_does_not_count(
    session: Session, tmp_path: Path
) -> None:
    other = tmp_path / "20270101T000000Z-r1.tlog"
    with printing_children() as children:
        session.recording._children = children
        session.recording.begin()
        other.write_bytes(b"frame")
        assert session.recording.file is None
        children.print_name(session.log)
        session.run(10.0)
        assert (session.recording.words, session.messages) == ("REC", [])
        session.run(10.0, grows=False)
        assert session.recording.words == "REC!"
        assert session.recording.end() == str(session.log)
        session.recording.begin()
        assert session.recording.file is None, "the new recorder has not created its file yet"


def test_recorder_that_starts_has_ten_seconds_to_write(session: Session) -> None:
    with printing_children() as children:
        session.recording._children = children
        session.recording.begin()
        session.run(9.0, grows=False)
        assert (session.recording.words, session.messages) == ("REC", [])
        session.run(2.0, grows=False)
        assert session.recording.words == "REC!"
        assert "nothing was written" in session.messages[0]


def test_no_recorder_means_no_messages(session: Session) -> None:
    session.run(10.0, grows=False)
    assert (session.recording.words, session.messages) == ("", [])
    with pytest.raises(UserError, match="nothing is being recorded here"):
        session.recording.end()


def test_recording_is_on_by_default(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert recordings_folder() == tmp_path / "sidestep" / "recordings"
    for verb in ("up", "ground"):
        assert folder_of(options(verb)) == recordings_folder()
        assert folder_of(options(verb, "--record", "here")) == Path("here")
        assert folder_of(options(verb, "--no-record")) is None
        with pytest.raises(SystemExit):
            options(verb, "--no-record", "--record", "here")


def options(*words: str) -> Namespace:
    found: Namespace = parse(words)
    return found


def test_begin_deletes_the_oldest_and_reports_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = tmp_path / "20260101T000000Z-r1.tlog"
    old.write_bytes(b"x" * 2_000_000)
    clock = ManualClock()
    recording = RecordingSession(tmp_path, COMMON, clock, None, keep="1MB")
    started: list[list[str]] = []
    monkeypatch.setattr(recording._children, "start", lambda _role, words: started.append(words))
    recording.begin()
    assert not old.exists()
    assert started[0][-2:] == ["--keep", "1MB"]
    assert "deleted the oldest recording in" in " ".join(recording.poll(is_receiving=True))
    assert recording.poll(is_receiving=True) == []


def test_begin_rejects_a_malformed_size(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="write it as 2GB or 500MB"):
        RecordingSession(tmp_path, COMMON, ManualClock(), None, keep="lots").begin()
    assert list(tmp_path.iterdir()) == []
