"""A recorder beside the app: started, looked after, killed, started anew, ended."""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ground.client.connection import Common
from ground.launch.recording_session import RecordingSession
from ground.recording.log_reader import open_log
from protocol.bus.network import Network
from runtime.clock import WallClock
from runtime.errors import UserError
from tests.support.bus.robots import played
from tests.support.until import until


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[RecordingSession]:
    with played() as (_, endpoint):
        network = Network(mode="client", connect=(endpoint,))
        common = Common(network=network, robot="r1")
        with RecordingSession(tmp_path, common, WallClock(), None) as found:
            yield found


def told_until(recording: RecordingSession, condition: Callable[[], bool]) -> list[str]:
    told: list[str] = []

    def met() -> bool:
        told.extend(recording.poll(is_receiving=True))
        return condition()

    until(met, what=lambda: f"told {told}")
    return told


def grown(recording: RecordingSession) -> bool:
    return recording.file is not None and recording.file.stat().st_size > 500


def test_it_is_begun_and_ended(recording: RecordingSession) -> None:
    recording.begin()
    assert told_until(recording, lambda: grown(recording)) == []
    assert recording.words == "REC"
    with pytest.raises(UserError, match="already recording"):
        recording.begin()
    file = Path(recording.end())
    assert recording.words == ""
    for path in (file, file.with_suffix(".mcap")):
        log = open_log(path)
        assert len(list(log)) > 0
        assert log.damage() == ""


def test_killed_recorder_is_reported_and_can_restart(
    recording: RecordingSession,
) -> None:
    recording.begin()
    told_until(recording, lambda: grown(recording))
    (child,) = recording._children.pids
    os.kill(child, signal.SIGKILL)
    (told,) = told_until(recording, lambda: recording.words == "REC!")
    assert "the recorder process exited unexpectedly (signal SIGKILL)" in told
    recording.begin()
    assert told_until(recording, lambda: grown(recording)) == []
