"""The first ten minutes: the real app in tmux, by keys that the screen has just named."""

import shutil
from pathlib import Path

import pytest

from checks.first_ten_minutes import STEPS, main

pytestmark = [
    pytest.mark.stack,
    pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine"),
]


def test_every_step_shows_what_it_must(tmp_path: Path) -> None:
    assert main(["--screens", str(tmp_path), "--speed", "3"]) == 0
    screens = sorted(tmp_path.iterdir())
    assert len(screens) == len(STEPS)
    assert "E-STOP" in screens[0].read_text()
