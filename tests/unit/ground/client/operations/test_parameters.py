"""Parameters: typed rows, single values and files; a refusal shows the allowed values."""

import json
from pathlib import Path

import pytest

from ground.client.link import UnansweredError
from ground.client.operations.parameters import (
    SAVING_NS,
    LoadParameters,
    ParameterChanged,
    ResetParameter,
    SaveParameters,
    SetParameter,
    ShowParameters,
)
from protocol.wire.messages import CommandAck, ParamSet, ParamValue
from protocol.wire.reasons import Reason
from runtime.errors import ConfigError, RemoteError, UserError
from tests.support.each import each
from tests.support.ground.client import ANSWER_NS, IN_PROGRESS, Stage

ROWS = [
    {
        "name": "d_obs_m", "value": 0.4, "default": 0.3, "unit": "m", "minimum": 0.05,
        "maximum": 3.0, "doc": "zone", "saved": True, "integer": False,
    },
    {"name": "side", "value": 1, "default": 1, "unit": "", "saved": False, "integer": True},
]  # fmt: skip
LIST = json.dumps(ROWS).encode()


def value(now: float, name: str = "d_obs_m") -> ParamValue:
    return ParamValue(param_id=name, param_value=now, param_type=9, param_count=2, param_index=0)


def denied(reason: Reason) -> CommandAck:
    return CommandAck(command=0, result=2, result_param2=reason)


def test_parameters_are_typed_and_keep_what_was_listed() -> None:
    outcome = ShowParameters().perform(Stage(LIST).session)
    first, second = outcome.parameters
    assert (first.name, first.value, first.default, first.unit) == ("d_obs_m", 0.4, 0.3, "m")
    assert (first.is_default, second.is_default) == (False, True)
    assert (second.saved, second.minimum, second.integer) == (False, None, True)
    assert outcome.as_json("param list", "r1") == {"parameters": ROWS}
    assert "0.4 *" in outcome.text


def test_pattern_chooses_and_must_match_something() -> None:
    outcome = ShowParameters(pattern="d_*", wide=False).perform(Stage(LIST).session)
    assert outcome.text == "d_obs_m = 0.4 m"
    with pytest.raises(UserError, match="no parameter matches 'zzz'"):
        ShowParameters(pattern="zzz").perform(Stage(LIST).session)


@each("pattern", ["d_obs", "d_osb_m"])
def test_pattern_without_a_match_suggests_a_name(pattern: str) -> None:
    with pytest.raises(UserError, match=r"did you mean 'd_obs_m'\?"):
        ShowParameters(pattern=pattern, wide=False).perform(Stage(LIST).session)


def test_only_changed_ones_may_be_none() -> None:
    rows = json.dumps([ROWS[1]]).encode()
    outcome = ShowParameters(only_changed=True).perform(Stage(rows).session)
    assert (outcome.ok, outcome.text) == (True, "all parameters have their default values")


def test_new_value_is_in_force_and_saved() -> None:
    stage = Stage(value(0.5), LIST)
    outcome = SetParameter(name="d_obs_m", value=0.5).perform(stage.session)
    assert (outcome.ok, outcome.now, outcome.saved) == (True, 0.5, True)
    assert outcome.text == "d_obs_m = 0.5, saved on the robot"
    (request, _) = stage.bus.requests
    assert isinstance(request, ParamSet)


@each("now", [0.4, float("nan")])
def test_another_value_in_force_is_no_success(now: float) -> None:
    outcome = SetParameter(name="d_obs_m", value=0.5).perform(Stage(value(now), LIST).session)
    assert (outcome.ok, outcome.text) == (
        False,
        f"not changed: the robot keeps d_obs_m = {now:.7g}",
    )
    assert outcome.as_json("", "r1")["reason"] == "the robot keeps another value"


def test_robot_that_lists_nothing_leaves_saved_unknown() -> None:
    stage = Stage(value(0.5), None, None, None)
    outcome = SetParameter(name="d_obs_m", value=0.5).perform(stage.session)
    assert outcome.saved is None
    assert "the robot does not report" in outcome.text


@each(
    ("name", "reason", "words"),
    [
        ("d_obs", Reason.UNKNOWN_PARAMETER, "; did you mean d_obs_m?"),
        ("zzz", Reason.UNKNOWN_PARAMETER, "; see sidestep param list"),
        ("d_obs_m", Reason.PARAMETER_OUT_OF_RANGE, "; allowed: 0.05 to 3 m"),
        ("side", Reason.PARAMETER_OUT_OF_RANGE, "range"),
    ],
)
def test_refusal_shows_the_allowed_values(name: str, reason: Reason, words: str) -> None:
    stage = Stage(denied(reason), LIST)
    outcome = SetParameter(name=name, value=9.0).perform(stage.session)
    assert (outcome.ok, outcome.now) == (False, None)
    assert outcome.text.startswith(f"refused: {name} = 9: ")
    assert outcome.refusal.endswith(words)
    assert "saved" not in outcome.as_json("", "r1")


def test_invalid_parameter_name_is_refused_before_sending() -> None:
    for name in ("", "a" * 17, "ü"):
        with pytest.raises(UserError, match="is not a valid parameter name"):
            SetParameter(name=name, value=1.0)


def test_robot_that_is_saving_is_asked_until_it_has_saved() -> None:
    stage = Stage(*[IN_PROGRESS] * 20, value(0.5), LIST)
    assert SetParameter(name="d_obs_m", value=0.5).perform(stage.session).ok


def test_robot_that_never_saves_is_given_up() -> None:
    stage = Stage(*[IN_PROGRESS] * (SAVING_NS // ANSWER_NS + 10))
    with pytest.raises(UnansweredError, match="still being saved"):
        SetParameter(name="d_obs_m", value=0.5).perform(stage.session)


def test_lost_answers_are_asked_for_three_times() -> None:
    stage = Stage(None, None, None)
    with pytest.raises(UnansweredError, match="no answer within the time"):
        ShowParameters().perform(stage.session)
    assert len(stage.bus.asked) == 3


def test_answer_that_is_no_list_is_refused() -> None:
    with pytest.raises(RemoteError, match="not a parameter list"):
        ShowParameters().perform(Stage(value(1.0)).session)


def test_default_is_set_again() -> None:
    stage = Stage(LIST, value(0.3), LIST)
    outcome = ResetParameter(name="d_obs_m").perform(stage.session)
    assert (outcome.ok, outcome.asked) == (True, 0.3)
    with pytest.raises(UserError, match="did you mean d_obs_m"):
        ResetParameter(name="d_obs").perform(Stage(LIST).session)


def test_file_keeps_what_differs_and_sets_it_again(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    saved = SaveParameters(file=path).perform(Stage(LIST).session)
    assert (saved.ok, saved.text) == (True, f"{path}: d_obs_m")
    path.write_text("[parameters]\nd_obs_m = 0.6\nside = -1\n")
    stage = Stage(LIST, value(0.6), denied(Reason.UNKNOWN_PARAMETER))
    loaded = LoadParameters(file=path).perform(stage.session)
    assert (loaded.ok, loaded.names) == (False, ("d_obs_m",))
    assert loaded.text == "refused: side = -1: the robot has no such parameter; set: d_obs_m"


def test_file_with_an_impossible_value_sets_nothing(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    path.write_text("[parameters]\nside = 1\nd_obs_m = 99\n")
    stage = Stage(LIST)
    with pytest.raises(ConfigError, match="99 is out of range"):
        LoadParameters(file=path).perform(stage.session)
    assert len(stage.bus.asked) == 1


def test_save_without_a_file_lists_the_saved_parameters() -> None:
    outcome = SaveParameters().perform(Stage(LIST).session)
    assert outcome.text == "nothing to do: saved on the robot: d_obs_m"
    none = json.dumps([ROWS[1]]).encode()
    assert not SaveParameters().perform(Stage(none).session).ok


def test_refused_change_as_json() -> None:
    refused = ParameterChanged(name="a", asked=1.0, now=None, refusal="no")
    row = {"verb": "param set", "robot": "r1", "name": "a", "ok": False, "value": None}
    assert refused.as_json("param set", "r1") == row | {"reason": "no"}
