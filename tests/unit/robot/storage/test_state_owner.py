"""A state directory belongs to one robot; another robot does not use it."""

import os
from pathlib import Path

import pytest

from robot import run
from robot.storage import OWNER_NAME, own
from runtime.errors import UserError


def test_first_robot_makes_the_directory_its_own(tmp_path: Path) -> None:
    state = tmp_path / "new" / "state"
    assert own(state, "r1") == ""
    assert (state / OWNER_NAME).read_text() == "r1"
    assert own(state, "r1") == "", "it comes back to it"


def test_another_robot_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    own(tmp_path, "r1")
    with pytest.raises(UserError, match="belongs to robot 'r1'; give robot r2 a directory"):
        own(tmp_path, "r2")
    assert (tmp_path / OWNER_NAME).read_text() == "r1"


def test_robot_process_does_not_start_on_the_state_of_another(tmp_path: Path) -> None:
    """Driving with the other robot's fence, or without one, must be impossible."""
    own(tmp_path, "r2")
    (tmp_path / "fence.json").write_text("[]")
    with pytest.raises(UserError, match="belongs to robot 'r2'"):
        run.main(["--id", "r1", "--state", str(tmp_path)])
    with pytest.raises(UserError, match="belongs to robot 'r2'"):
        run.main(["--id", "r1", "--stops", str(tmp_path)])


@pytest.mark.parametrize("content", [b"", b"\xff", b"r1\x1b]0;OWNED\x07"])
def test_state_with_an_unreadable_owner_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / OWNER_NAME).write_bytes(content)
    with pytest.raises(UserError) as refused:
        own(tmp_path, "r1")
    assert str(refused.value).isprintable()


def test_full_disk_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert own(tmp_path / "state", "r1").endswith(
        "robot.txt: not written (No space left on device)"
    )


def test_without_a_directory_no_owner_is_noted() -> None:
    assert own(None, "r1") == ""
