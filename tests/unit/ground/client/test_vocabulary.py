"""Values of parameters are shown and typed by name."""

import pytest

from ground.client.vocabulary import (
    HINTS,
    MODE_SUMMARIES,
    NAVIGATOR_SUMMARIES,
    PYTHON,
    SHELL,
    value_in_words,
    value_words,
)
from protocol.wire.enums import Mode, Navigator
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import UserError
from tests.support.each import each


@each(
    ("parameter", "words", "value"),
    [("navigator", "bug", 1), ("navigator", "vgm_memory", 6), ("side", "left", 1),
     ("side", "right", -1), ("d_obs_m", "0.35", 0.35)],
)  # fmt: skip
def test_value_is_shown_and_typed_by_its_name(parameter: str, words: str, value: float) -> None:
    assert value_words(parameter, value) == words
    assert value_in_words(parameter, words) == value


@each(("words", "value"), [("1", 1.0), ("BUG", 1.0), ("-1e0", -1.0)])
def test_number_and_any_case_are_accepted(words: str, value: float) -> None:
    assert value_in_words("navigator", words) == value


def test_value_without_a_name_is_a_number() -> None:
    assert value_words("navigator", 99) == "99"
    assert value_words("d_obs_m", 0.1 + 0.2) == "0.3"


@each("words", ["", "nan", "inf", "-inf", "buggy", "1,5"])
def test_word_that_is_no_value_is_an_error(words: str) -> None:
    with pytest.raises(UserError, match="must be a finite number or one of bug, vgm"):
        value_in_words("navigator", words)
    with pytest.raises(UserError, match=r"must be a finite number$"):
        value_in_words("d_obs_m", words)


def test_every_mode_and_navigator_has_a_summary() -> None:
    assert set(MODE_SUMMARIES) == {one.name.lower() for one in Mode}
    assert set(NAVIGATOR_SUMMARIES) == {one.name.lower() for one in Navigator}


PLAIN = {
    *(Reason.GOAL_OUT_OF_RANGE, Reason.TOLERANCE_OUT_OF_RANGE, Reason.UNKNOWN_MODE),
    *(Reason.UNKNOWN_NAVIGATOR, Reason.UNKNOWN_COMMAND, Reason.UNKNOWN_PARAMETER),
    *(Reason.PARAMETER_OUT_OF_RANGE, Reason.NO_TRAIL, Reason.NOT_SAVED, Reason.MALFORMED),
    *(Reason.MISSION_EMPTY, Reason.MISSION_ITEM_BAD, Reason.MISSION_TOO_LONG),
    *(Reason.HOLD_OUT_OF_RANGE, Reason.UNKNOWN_FRAME, Reason.FENCE_NOT_SIMPLE),
    *(Reason.FENCE_LEAVES_ROBOT_OUT, Reason.TOO_LATE, Reason.NOT_WHILE_ARMED),
    *(Reason.LESS_SAFE_THAN_CONFIGURED, Reason.NO_IDENTITY, Reason.ALREADY_OVER),
}
"""Refusals whose text names the wrong input or the state, which is the remedy."""


@each("reason", [one for one in Reason if 0 < one < 30 or one >= 100])
def test_every_refusal_names_its_remedy(reason: Reason) -> None:
    assert (reason in HINTS or ": " in reason_text(reason)) != (reason in PLAIN)


def test_python_has_a_remedy_for_each_refusal_of_the_shell() -> None:
    assert SHELL.refusals.keys() <= PYTHON.refusals.keys()
    words = " ".join([*PYTHON.refusals.values(), *PYTHON[1:]])
    assert "--" not in words
    assert words.count("sidestep ") == words.count("`sidestep doctor` in a terminal") == 1


def test_every_cause_that_arming_does_not_lift_has_a_hint() -> None:
    assert {Reason.FENCE_BREACHED, Reason.FENCE_UNCHECKED} <= HINTS.keys()
