"""A directory belongs to one study: differences are refused, or accepted with a message."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import UserError
from study.runner.rows import machine
from study.runner.store import FILE, check_settings, exclusive, settings_of
from tests.support.study.made import CODE, boxed, floor, list_of, settings

WORLDS = list_of(floor(), boxed())


def usual() -> dict[str, Any]:
    return settings_of(WORLDS, settings(), CODE, machine())


def settled(directory: Path, wanted: Mapping[str, Any], *, mixed: bool = False) -> list[str]:
    return check_settings(directory, wanted, CODE, mixed=mixed)


def test_equal_settings_are_accepted(tmp_path: Path) -> None:
    assert settled(tmp_path, usual()) == []
    assert settled(tmp_path, usual()) == []


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"seeds": 3}, "seeds was 1, is 3"),
        ({"noise": ["none", "harsh"]}, "noise was none, is none harsh"),
        ({"timeout_s": None}, "timeout_s was 20.0, is null"),
        ({"parameters": {"d_obs_m": 0.4}}, 'parameters was {}, is {"d_obs_m": 0.4}'),
        ({"calibrated": False}, "calibrated was true, is false"),
        ({"code": "d2"}, "other code (it was made at commit c0ffee)"),
        ({"numpy": "9.9"}, "numpy was"),
        ({"worlds": {"floor": "another"}}, "2 worlds were, 1 are (disc, floor)"),
    ],
)
def test_different_settings_are_refused_by_name(
    tmp_path: Path, changed: dict[str, Any], message: str
) -> None:
    settled(tmp_path, usual())
    with pytest.raises(UserError) as refused:
        settled(tmp_path, usual() | changed)
    assert message in str(refused.value)
    assert "--mixed" in str(refused.value)
    assert settled(tmp_path, usual()) == []


def test_mixed_reports_the_difference_once(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    assert settled(tmp_path, usual() | {"seeds": 3}, mixed=True) == ["seeds was 1, is 3"]
    assert settled(tmp_path, usual() | {"seeds": 3}) == []


def test_message_lists_a_few_of_many_worlds(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    many = {f"w{number:02}": "x" for number in range(40)}
    with pytest.raises(UserError, match=r"2 worlds were, 40 are \(disc, floor, w00 and 39 more\)"):
        settled(tmp_path, usual() | {"worlds": many})


@pytest.mark.parametrize("content", ["", "{", "[1]", "\x00"])
def test_unreadable_settings_are_reported_with_advice(tmp_path: Path, content: str) -> None:
    (tmp_path / FILE).write_text(content)
    with pytest.raises(UserError, match=r"settings\.json: .*remove it"):
        settled(tmp_path, usual())


def test_settings_are_stored_with_the_commit(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    assert json.loads((tmp_path / FILE).read_text())["commit"] == "c0ffee"


def test_second_study_in_a_directory_is_refused(tmp_path: Path) -> None:
    with (
        exclusive(tmp_path / "new"),
        pytest.raises(UserError, match="another study is writing there"),
        exclusive(tmp_path / "new"),
    ):
        raise AssertionError("both are in")


def test_lock_is_released_at_the_end(tmp_path: Path) -> None:
    for _ in range(2):
        with exclusive(tmp_path / "new"):
            assert (tmp_path / "new").is_dir()


def test_file_as_output_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(UserError, match=r"--output .*taken"), exclusive(tmp_path / "taken"):
        raise AssertionError("a file is no directory")
