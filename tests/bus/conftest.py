"""Fixtures: a simulated robot with a command line connected to it; a stack and a ROS 2 peer."""

from collections.abc import Iterator

import pytest

from ground.cli.main import main
from tests.support.gateway.ros_network import RosPeer, free_endpoint
from tests.support.played_robot import PlayedRobot, Say, played
from tests.support.stacks import Paced


@pytest.fixture
def stage() -> Iterator[tuple[PlayedRobot, str]]:
    with played() as found:
        yield found


@pytest.fixture
def robot(stage: tuple[PlayedRobot, str]) -> PlayedRobot:
    return stage[0]


@pytest.fixture
def say(stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]) -> Say:
    """Run a verb against the robot: exit code, standard output, standard error."""

    def run(*words: str) -> tuple[int, str, str]:
        code = main([*words, "--connect", stage[1]])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.fixture
def stack() -> Iterator[Paced]:
    with Paced() as found, found.going():
        yield found


@pytest.fixture
def peer() -> Iterator[RosPeer]:
    found = RosPeer(free_endpoint())
    yield found
    found.close()
