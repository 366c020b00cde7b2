"""A mission made by hand: a waypoint more, one less, saved and sent."""

from pathlib import Path

import pytest

from ground.console.parser import read
from ground.missions.draft import Draft, Edit
from ground.missions.files import read_text
from ground.missions.mission import Waypoint
from runtime.errors import UserError
from tests.support.each import each


def say(draft: Draft, text: str) -> str:
    """Return the answer of the console to `text`."""
    edit = read(text)
    assert isinstance(edit, Edit)
    return draft.apply(edit)


def test_waypoints_are_added_listed_and_taken_out() -> None:
    draft = Draft()
    assert say(draft, "wp list") == "the draft is empty: wp add X Y [DEG]"
    assert say(draft, "wp add 1 -2 90 --hold 3") == "waypoint 1: (1, -2) at 90 deg, hold 3 s"
    say(draft, "wp add 3 4")
    assert say(draft, "wp list") == "1  (1, -2) at 90 deg, hold 3 s\n2  (3, 4)"
    assert say(draft, "wp remove 1") == "taken out: (1, -2) at 90 deg, hold 3 s"
    assert draft.mission.waypoints == (Waypoint(x_m=3.0, y_m=4.0),)
    assert say(draft, "wp clear") == "the draft is empty"


def test_what_is_sent_is_the_draft_as_a_mission_file() -> None:
    draft = Draft()
    say(draft, "wp add 1 2 45")
    assert read_text(draft.text, Path("-")).mission == draft.mission


def test_a_draft_is_saved_and_loaded(tmp_path: Path) -> None:
    draft, other = Draft(), Draft()
    say(draft, "wp add 1 2")
    assert "1 waypoint" in say(draft, f"wp save {tmp_path / 'm.toml'}")
    say(other, f"wp load {tmp_path / 'm.toml'}")
    assert other.mission == draft.mission


@each(
    ("text", "why"),
    [
        ("wp add 9e9 0", "x_m 9e[+]09: expected"),
        ("wp add 0 0 400", "heading_deg 400: expected"),
        ("wp add 0 0 --hold -1", "hold_s -1: expected"),
        ("wp remove 3", "there is no waypoint 3"),
        ("wp save m.toml", "the draft is empty"),
        ("wp load m.txt", "ends in"),
    ],
)
def test_what_cannot_be_done_is_refused_and_leaves_the_draft(text: str, why: str) -> None:
    draft = Draft()
    with pytest.raises(UserError, match=why):
        say(draft, text)
    assert draft.mission.waypoints == ()


def test_an_empty_draft_cannot_be_sent() -> None:
    with pytest.raises(UserError, match="wp add X Y"):
        _ = Draft().text
