"""What a person sees of `make up`: the app on a terminal that is emulated here."""

import pyte
import pytest

from checks.harness.terminal import Terminal
from tests.support.until import until

pytestmark = pytest.mark.stack

SIZE = (100, 30)


class Screen:
    """An emulated terminal: what the app has drawn on it until now."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal, self._fed = terminal, 0
        self._screen = pyte.Screen(*SIZE)
        self._stream = pyte.Stream(self._screen)

    def __str__(self) -> str:
        text = self._terminal.text().rstrip("\ufffd")  # of a character only a part was read
        self._stream.feed(text[self._fed :])
        self._fed = len(text)
        return "\n".join(self._screen.display)

    def shows(self, *words: str) -> None:
        """Wait until all these words are on the screen."""
        until(
            lambda: all(word in str(self) for word in words),
            what=lambda: f"{words}:\n{self}",
            poll_s=0.05,
        )


@pytest.mark.brief
def test_drive_is_drawn_to_its_end_and_space_stops_the_robot() -> None:
    with Terminal(("up", "--speed", "10"), SIZE) as terminal:
        screen = Screen(terminal)
        screen.shows("● r1", "AUTO", "goal", "pose", "space E-STOP")
        screen.shows("REACHED", "reached in", "100 %")
        terminal.type(" ")
        screen.shows("EMERGENCY")
        assert "Traceback" not in terminal.text()
