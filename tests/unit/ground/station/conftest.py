"""The threads of a station that a test plays take no time."""

import pytest

from ground.client import robot_link
from ground.station.robot import robot_stop
from tests.support.ground.station import ThreadAtOnce


@pytest.fixture(autouse=True)
def _no_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_link, "Thread", ThreadAtOnce)
    monkeypatch.setattr(robot_stop, "Thread", ThreadAtOnce)
    monkeypatch.setattr(ThreadAtOnce, "held", set())
    monkeypatch.setattr(ThreadAtOnce, "waiting", {})
