"""A study's directory is of one study: whatever differs is named and refused, or let in aloud."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import UserError
from study.runner.provenance import machine
from study.runner.study_settings import FILE, alone, settings_of, settle
from tests.support.study.made import CODE, boxed, floor, list_of, settings

WORLDS = list_of(floor(), boxed())


def usual() -> dict[str, Any]:
    return settings_of(WORLDS, settings(), CODE, machine())


def settled(directory: Path, wanted: Mapping[str, Any], *, mixed: bool = False) -> list[str]:
    return settle(directory, wanted, CODE, mixed=mixed)


def test_the_same_settings_go_on(tmp_path: Path) -> None:
    assert settled(tmp_path, usual()) == []
    assert settled(tmp_path, usual()) == []


@pytest.mark.parametrize(
    ("changed", "says"),
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
def test_what_differs_is_named_and_refused(
    tmp_path: Path, changed: dict[str, Any], says: str
) -> None:
    settled(tmp_path, usual())
    with pytest.raises(UserError) as refused:
        settled(tmp_path, usual() | changed)
    assert says in str(refused.value)
    assert "--mixed" in str(refused.value)
    assert settled(tmp_path, usual()) == []


def test_mixed_goes_on_and_says_what_differs_once(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    assert settled(tmp_path, usual() | {"seeds": 3}, mixed=True) == ["seeds was 1, is 3"]
    assert settled(tmp_path, usual() | {"seeds": 3}) == []


def test_of_many_other_worlds_only_some_are_named(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    many = {f"w{number:02}": "x" for number in range(40)}
    with pytest.raises(UserError, match=r"2 worlds were, 40 are \(disc, floor, w00 and 39 more\)"):
        settled(tmp_path, usual() | {"worlds": many})


@pytest.mark.parametrize("content", ["", "{", "[1]", "\x00"])
def test_settings_that_cannot_be_read_are_named_with_what_to_do(
    tmp_path: Path, content: str
) -> None:
    (tmp_path / FILE).write_text(content)
    with pytest.raises(UserError, match=r"settings\.json: .*remove it"):
        settled(tmp_path, usual())


def test_the_settings_are_stored_with_the_commit(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    assert json.loads((tmp_path / FILE).read_text())["commit"] == "c0ffee"


def test_two_studies_do_not_write_into_one_directory(tmp_path: Path) -> None:
    with (
        alone(tmp_path / "new"),
        pytest.raises(UserError, match="another study writes there"),
        alone(tmp_path / "new"),
    ):
        raise AssertionError("both are in")


def test_the_directory_is_free_again_afterwards(tmp_path: Path) -> None:
    for _ in range(2):
        with alone(tmp_path / "new"):
            assert (tmp_path / "new").is_dir()


def test_a_file_in_the_place_of_the_directory_is_told(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(UserError, match=r"--output .*taken"), alone(tmp_path / "taken"):
        raise AssertionError("a file is no directory")
