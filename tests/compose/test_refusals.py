"""Wrong settings are refused with a message in the log."""

import socket
from contextlib import closing

import pytest

from tests.support.compose.compose import project
from tests.support.until import until

pytestmark = pytest.mark.compose


def test_a_port_that_is_taken_is_named(image: str) -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        with project(image, settings={"PORT": port}) as compose:
            done = compose.tries("up", "-d", "--no-build")
    assert done.code != 0
    assert port in done.said
    assert "in use" in done.said or "allocated" in done.said


@pytest.mark.parametrize(
    ("settings", "part", "words"),
    [
        ({"WORLD": "atlantis"}, "robot", "atlantis"),
        ({"ROBOTS": "0"}, "plant", "--robots: 0 is not within 1 to 20"),
        ({"NOISE": "loud"}, "plant", "--noise: invalid choice: 'loud'"),
    ],
)
def test_a_setting_that_cannot_be_is_named_in_the_log(
    image: str, settings: dict[str, str], part: str, words: str
) -> None:
    with project(image, settings=settings) as compose:
        compose.tries("up", "-d", "--no-build", part)
        until(lambda: words in compose.logs(part), 30.0, f"{words}; it says {compose.logs(part)}")
        assert "Traceback" not in compose.logs()
