"""Fixtures for tests of verbs: a simulated robot and a command line connected to it."""

from collections.abc import Iterator

import pytest

from ground.cli.main import main
from tests.support.played_robot import PlayedRobot, Say, played


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
