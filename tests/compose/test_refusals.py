"""Wrong settings are refused with a message in the log."""

import socket
from collections.abc import Iterator
from contextlib import closing

import pytest

from tests.support.compose.compose import Compose, project

pytestmark = pytest.mark.compose


@pytest.fixture(scope="module")
def refusing(image: str) -> Iterator[Compose]:
    """Provide one project for all wrong settings: nothing of it stays up."""
    with project(image) as compose:
        yield compose


@pytest.mark.parametrize(
    ("settings", "part", "words"),
    [
        ({"WORLD": "atlantis"}, "robot", "atlantis"),
        ({"ROBOTS": "0"}, "plant", "--robots: 0 is not within 1 to 20"),
        ({"NOISE": "loud"}, "plant", "--noise: invalid choice: 'loud'"),
    ],
)
def test_a_setting_that_cannot_be_is_named(
    refusing: Compose, settings: dict[str, str], part: str, words: str
) -> None:
    refusing.settings = settings
    # Under the name that `up` gives, by which a robot finds its number.
    named = ("--name", refusing.container(part))
    done = refusing.tries("run", "--rm", "-T", "--no-deps", *named, part)
    assert (done.code, words in done.said) == (2, True), done.said
    assert "Traceback" not in done.said


def test_a_port_that_is_taken_is_named(refusing: Compose) -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        refusing.settings = {"PORT": port}
        done = refusing.tries("up", "-d", "--no-build", "--no-deps", "web")
    assert done.code != 0
    assert port in done.said
    assert "in use" in done.said or "allocated" in done.said
