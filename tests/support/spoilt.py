"""Real processes that hang with Python's lock held, or fail, when a file asks them to."""

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from runtime.cli.verb_table import find

ROOT: Final = Path(__file__).parents[2]
SCRIPT: Final = """
import sys
sys.path.insert(0, {root!r})
from tests.support.spoilt import spoil
spoil({folder!r}, sys.argv[2:])
from ground.launch.child_command import main
sys.exit(main(sys.argv[1:]))
"""
"""In place of ground/launch/sidestep_process.py."""


class Sabotage:
    """Files in a folder: one with the name of a verb is taken away and done."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @property
    def start(self) -> Path:
        """The script that starts a process which looks for the files."""
        script = self._folder / "sabotaged_process.py"
        script.write_text(SCRIPT.format(root=str(ROOT), folder=str(self._folder)))
        return script

    def hang(self, verb: str) -> None:
        """Hang until the process is killed; threads of libraries continue."""
        (self._folder / verb).write_text("hang")

    def fail(self, verb: str) -> None:
        (self._folder / verb).write_text("fail")


def spoil(folder: str, words: Sequence[str]) -> None:
    """Let each round of this verb's loop look for its file."""
    call = find(words)
    assert call is not None
    verb = call.word
    asked = Path(folder) / verb
    if verb == "robot":
        from robot.core import brain

        before(brain, "step", asked)
    elif verb == "plant":
        from plant.sim.simulation import Plant

        before(Plant, "advance", asked)
    elif verb == "router":
        from runtime.clock import WallClock

        before(WallClock, "sleep_until", asked)


def before(owner: Any, name: str, asked: Path) -> None:
    whole: Callable[..., Any] = getattr(owner, name)

    def first(*given: Any) -> Any:
        if asked.exists():
            do(asked)
        return whole(*given)

    setattr(owner, name, first)


def do(asked: Path) -> None:
    what = asked.read_text()
    asked.unlink()
    if what == "fail":
        raise ZeroDivisionError("as the test wants it")
    ctypes.PyDLL(None).sleep(60)
