"""Drive the real app in tmux by keys alone, as a new user does, and check each screen.

`python -m checks.first_ten_minutes [--screens DIR] [--speed F]` goes from `sidestep tutorial`
to a goal of its own, a mission, a stop and its clearing. Every key that it presses stands on the
screen before. With `--screens`, it keeps each screen as a text file; with `--speed`, the robot
drives faster than in real time.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from threading import Event
from typing import Final, NamedTuple

from checks.harness.until import until

ROOT: Final = Path(__file__).resolve().parents[1]
SIZE: Final = (100, 30)
PATIENCE_S: Final = 60.0
POLL_S: Final = 0.1


class TutorialStep(NamedTuple):
    """The words that must be on the screen, then the keys that they ask for, by tmux's names."""

    name: str
    before: tuple[str, ...]
    keys: tuple[str, ...]


STEPS: Final = (
    TutorialStep("first goal", ("1 Drive", "TUTORIAL 1 of 8", "space E-STOP", "? Help"), ()),
    TutorialStep(
        "own goal", ("TUTORIAL 2 of 8", "press g, type 1 1", "g Goal"), ("g", "1 1", "Enter")
    ),
    TutorialStep("driving", ("goal 1 1: ok", "h Hold", "x Abort"), ()),
    TutorialStep("cursor", ("TUTORIAL 3 of 8", "G shows a cursor", "goal REACHED"), ("G",)),
    TutorialStep("first waypoint", ("enter Go", "w Waypoint", "Move"), (*["Up"] * 4, "w")),
    TutorialStep("second waypoint", ("waypoint 1:", "W Send 1 waypoint"), (*["Right"] * 4, "w")),
    TutorialStep("send", ("TUTORIAL 4 of 8", "press W", "W Send 2 waypoints"), ("W",)),
    TutorialStep("start", ("TUTORIAL 5 of 8", "W Start mission"), ("W",)),
    TutorialStep("stop", ("TUTORIAL 6 of 8", "press space", "space E-STOP"), ("Space",)),
    TutorialStep("clear", ("TUTORIAL 7 of 8", "EMERGENCY STOP", "D D Clear E-STOP"), ("D", "D")),
    TutorialStep("arm", ("TUTORIAL 8 of 8", "DISARMED", "a arm"), ("a",)),
    TutorialStep("help", ("TUTORIAL  all done", "ARMED", "? Help"), ("?",)),
    TutorialStep("end", ("examples", "esc closes"), ("Escape",)),
)


class TmuxWindow:
    """A tmux server of its own with one window, in which a command runs."""

    def __init__(self, folder: Path, command: str) -> None:
        self._socket = folder / "tmux"
        self._pause = Event()
        columns, rows = map(str, SIZE)
        self.tmux("-f", "/dev/null", "new-session", "-d", "-x", columns, "-y", rows, command)

    def tmux(self, *words: str) -> str:
        """Run a command of tmux and return its output."""
        done = subprocess.run(
            ["tmux", "-S", str(self._socket), *words], capture_output=True, text=True, check=True
        )
        return done.stdout

    def shows(self, words: Sequence[str]) -> str:
        """Wait for a screen with all of these words, and return it."""
        shown = ""

        def is_there() -> bool:
            nonlocal shown
            self._pause.wait(POLL_S)
            shown = self.tmux("capture-pane", "-p")
            return all(word in shown for word in words)

        try:
            until(is_there, f"{', '.join(words)} on the screen", PATIENCE_S)
        except RuntimeError as error:
            raise RuntimeError(f"{error}\n{shown}") from None
        return shown


def walk(window: TmuxWindow, screens: Path | None) -> None:
    """Take all steps. Raise RuntimeError with the screen that does not show what it must."""
    for number, step in enumerate(STEPS, start=1):
        shown = window.shows(step.before)
        print(f"{number:>2} {step.name:<16} shows {', '.join(step.before)}", flush=True)
        if screens is not None:
            name = f"{number:02}-{step.name.replace(' ', '-')}.txt"
            (screens / name).write_text(shown, encoding="utf-8")
        for key in step.keys:
            window.tmux("send-keys", key)


def main(arguments: Sequence[str]) -> int:
    """Run the walk; return 0 when every screen has shown what it must."""
    parser = argparse.ArgumentParser(prog="first_ten_minutes")
    parser.add_argument("--screens", type=Path, metavar="DIR", help="keep the screens here")
    parser.add_argument("--speed", type=float, default=1.0, metavar="F", help="of the drives (1)")
    options = parser.parse_args(arguments)
    screens: Path | None = options.screens
    if screens is not None:
        screens.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        state = f"XDG_STATE_HOME={folder} XDG_CONFIG_HOME={folder} PYTHONPATH={ROOT}"
        words = f"-m sidestep tutorial --speed {options.speed:g}"
        command = f"env -u COLUMNS -u LINES {state} {sys.executable} {words}"
        window = TmuxWindow(Path(folder), command)
        try:
            walk(window, screens)
        finally:
            window.tmux("kill-server")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
