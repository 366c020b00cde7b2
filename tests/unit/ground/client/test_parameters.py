"""Parameters: the robot's list, values by name, files, and the limits of safety parameters."""

import json
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ground.client import parameter_file
from ground.client.parameter import Parameter, parameters_in
from ground.client.parameter_rows import MAX_ROWS, MAX_TEXT, rows_in
from ground.client.parameters import SAVING_NS, ParameterChanged, ParametersLoaded, hint
from ground.client.robot_link import UnansweredError
from ground.client.vocabulary import (
    HINTS,
    MODE_SUMMARIES,
    NAVIGATOR_SUMMARIES,
    PYTHON,
    SHELL,
    value_in_words,
    value_words,
)
from ground.commands import param
from ground.commands.param import (
    LoadParameters,
    ResetParameter,
    SaveParameters,
    SetParameter,
    ShowChanged,
    ShowParameters,
    ShowValues,
    table,
)
from protocol.wire.enums import Mode, Navigator
from protocol.wire.messages import CommandAck, ParamSet, ParamValue
from protocol.wire.reasons import Reason, reason_text
from robot.core.parameters import DEFAULTS
from robot.parameter_table import described, with_value
from runtime.errors import ConfigError, RemoteError, UserError
from tests.support.each import each
from tests.support.ground.client import ANSWER_NS, IN_PROGRESS, Stage, perform
from tests.support.hostile import TEXT, raw_in

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
    outcome = perform(ShowParameters(), Stage(LIST))
    first, second = outcome.parameters
    assert (first.name, first.value, first.default, first.unit) == ("d_obs_m", 0.4, 0.3, "m")
    assert (first.is_default, second.is_default) == (False, True)
    assert (second.saved, second.minimum, second.integer) == (False, None, True)
    assert outcome.as_json("param list", "r1") == {"parameters": ROWS}
    assert "0.4 *" in outcome.text


def test_pattern_chooses_and_must_match_something() -> None:
    outcome = perform(ShowValues(pattern="d_*"), Stage(LIST))
    assert outcome.text == "d_obs_m = 0.4 m"
    with pytest.raises(UserError, match="no parameter matches 'zzz'"):
        perform(ShowParameters(pattern="zzz"), Stage(LIST))


@each("pattern", ["d_obs", "d_osb_m"])
def test_pattern_without_a_match_suggests_a_name(pattern: str) -> None:
    with pytest.raises(UserError, match=r"did you mean 'd_obs_m'\?"):
        perform(ShowValues(pattern=pattern), Stage(LIST))


def test_only_changed_ones_may_be_none() -> None:
    rows = json.dumps([ROWS[1]]).encode()
    outcome = perform(ShowChanged(), Stage(rows))
    assert (outcome.ok, outcome.text) == (True, "all parameters have their default values")


def test_new_value_is_in_force_and_saved() -> None:
    stage = Stage(value(0.5), LIST)
    outcome = perform(SetParameter(name="d_obs_m", value=0.5), stage)
    assert isinstance(outcome, ParameterChanged)
    assert (outcome.ok, outcome.now, outcome.saved) == (True, 0.5, True)
    assert outcome.text == "d_obs_m = 0.5, saved on the robot"
    (request, _) = stage.bus.requests
    assert isinstance(request, ParamSet)


@each("now", [0.4, float("nan")])
def test_another_value_in_force_is_no_success(now: float) -> None:
    outcome = perform(SetParameter(name="d_obs_m", value=0.5), Stage(value(now), LIST))
    assert (outcome.ok, outcome.text) == (
        False,
        f"not changed: the robot keeps d_obs_m = {now:.7g}",
    )
    assert outcome.as_json("", "r1")["reason"] == "the robot keeps another value"


def test_robot_that_lists_nothing_leaves_saved_unknown() -> None:
    stage = Stage(value(0.5), None, None, None)
    outcome = perform(SetParameter(name="d_obs_m", value=0.5), stage)
    assert isinstance(outcome, ParameterChanged)
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
    outcome = perform(SetParameter(name=name, value=9.0), stage)
    assert isinstance(outcome, ParameterChanged)
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
    assert perform(SetParameter(name="d_obs_m", value=0.5), stage).ok


def test_robot_that_never_saves_is_given_up() -> None:
    stage = Stage(*[IN_PROGRESS] * (SAVING_NS // ANSWER_NS + 10))
    with pytest.raises(UnansweredError, match="still being saved"):
        perform(SetParameter(name="d_obs_m", value=0.5), stage)


def test_lost_answers_are_asked_for_three_times() -> None:
    stage = Stage(None, None, None)
    with pytest.raises(UnansweredError, match="no answer within the time"):
        perform(ShowParameters(), stage)
    assert len(stage.bus.asked) == 3


def test_answer_that_is_no_list_is_refused() -> None:
    with pytest.raises(RemoteError, match="not a parameter list"):
        perform(ShowParameters(), Stage(value(1.0)))


def test_default_is_set_again() -> None:
    stage = Stage(LIST, value(0.3), LIST)
    outcome = perform(ResetParameter(name="d_obs_m"), stage)
    assert isinstance(outcome, ParameterChanged)
    assert (outcome.ok, outcome.asked) == (True, 0.3)
    with pytest.raises(UserError, match="did you mean d_obs_m"):
        perform(ResetParameter(name="d_obs"), Stage(LIST))


def test_file_keeps_what_differs_and_sets_it_again(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    saved = perform(SaveParameters(file=path), Stage(LIST))
    assert (saved.ok, saved.text) == (True, f"{path}: d_obs_m")
    path.write_text("[parameters]\nd_obs_m = 0.6\nside = -1\n")
    stage = Stage(LIST, value(0.6), denied(Reason.UNKNOWN_PARAMETER))
    loaded = perform(LoadParameters(file=path), stage)
    assert isinstance(loaded, ParametersLoaded)
    assert (loaded.ok, loaded.names) == (False, ("d_obs_m",))
    assert loaded.text == "refused: side = -1: the robot has no such parameter; set: d_obs_m"


def test_file_with_an_impossible_value_sets_nothing(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    path.write_text("[parameters]\nside = 1\nd_obs_m = 99\n")
    stage = Stage(LIST)
    with pytest.raises(ConfigError, match="99 is out of range"):
        perform(LoadParameters(file=path), stage)
    assert len(stage.bus.asked) == 1


def test_save_without_a_file_lists_the_saved_parameters() -> None:
    outcome = perform(SaveParameters(), Stage(LIST))
    assert outcome.text == "nothing to do: saved on the robot: d_obs_m"
    none = json.dumps([ROWS[1]]).encode()
    assert not perform(SaveParameters(), Stage(none)).ok


def test_refused_change_as_json() -> None:
    refused = ParameterChanged(name="a", asked=1.0, now=None, refusal="no")
    row = {"verb": "param set", "robot": "r1", "name": "a", "ok": False, "value": None}
    assert refused.as_json("param set", "r1") == row | {"reason": "no"}


STRICTER = with_value(DEFAULTS, "op_lost_ms", 900)
STRICTER_ROWS = parameters_in(json.dumps(described(STRICTER, DEFAULTS)))


@each(
    ("name", "words"),
    [
        ("op_lost_ms", "; configured: 1500 ms, no higher"),
        ("guard_stop_m", "; configured: 0.04 m, no lower"),
        ("wheel_share", "; configured: 0.1, no lower"),
        ("track_m", "; configured: 0.2 m, within a tenth of that"),
    ],
)
def test_refusal_as_less_safe_shows_the_limit(name: str, words: str) -> None:
    assert hint(STRICTER_ROWS, name, Reason.LESS_SAFE_THAN_CONFIGURED, "") == words


def test_list_shows_the_safer_direction() -> None:
    lines = {line.split()[0]: line.split() for line in param.table(STRICTER_ROWS).splitlines()}
    assert lines["name"][6] == "safer"
    assert lines["op_lost_ms"][:8] == [
        "op_lost_ms",
        "900",
        "*",
        "ms",
        "200",
        "60000",
        "1500",
        "down",
    ]
    assert "up" in lines["guard_stop_m"]
    assert not {"up", "down", "near"} & set(lines["d_th_m"][:7])


NAMES = st.text(min_size=1, max_size=18) | st.from_regex(r"[A-Za-z0-9_]{1,16}", fullmatch=True)
TEXTS = st.text() | st.just('x"\n[network]\nconnect = ["tcp/evil:1"]\n#')
NUMBERS = st.floats() | st.integers() | st.booleans() | st.none()
LISTS = st.lists(
    st.fixed_dictionaries(
        {"name": NAMES, "value": NUMBERS},
        optional={"default": NUMBERS, "unit": TEXTS, "doc": TEXTS, "minimum": NUMBERS},
    ),
    max_size=4,
)


def answer(**more: object) -> bytes:
    return json.dumps([{"name": "d_obs_m", "value": 0.3, **more}]).encode()


@each(
    ("found", "why"),
    [
        (answer(name="a = 1\n[network]\nb"), "has no name"),
        (answer(name="x" * 17), "has no name"),
        (answer(name=["a"]), "has no name"),
        (answer(value="0.3"), "no finite number as its value"),
        (answer(value=True), "no finite number as its value"),
        (answer(value=float("nan")), "no finite number as its value"),
        (answer(value=1e999), "no finite number as its value"),
        (answer(default={}), "has a default"),
        (answer(minimum="low"), "has a minimum"),
        (answer(doc=["a"]), "has a doc"),
        (answer(unit=3), "has a unit"),
        (answer(**{f"k{i}": 1 for i in range(50)}), "is not a table"),
        (b"[3]", "is not a table"),
        (b"{}", "not a list"),
        (
            json.dumps([{"name": "a", "value": 1}] * (MAX_ROWS + 1)).encode(),
            "not a list of at most",
        ),
        (json.dumps([{"name": "a", "value": 1}] * 2).encode(), "duplicate name"),
        (b"[" * 100_000, "nested too deeply"),
        (b"\xff", "cannot read the parameter list"),
    ],
)
def test_a_malformed_list_is_refused(found: bytes, why: str) -> None:
    with pytest.raises(RemoteError, match=why):
        rows_in(found)


def test_texts_are_one_printable_line_of_bounded_length() -> None:
    (row,) = rows_in(answer(doc=TEXT + "\n", unit=TEXT, note="d" * 1000, nested=[1], empty=None))
    assert raw_in(f"{row['doc']}{row['unit']}") == []
    assert "\n" not in str(row["doc"])
    assert len(str(row["note"])) == MAX_TEXT
    assert "nested" not in row
    found = parameters_in(answer(doc=TEXT + "\n", unit=TEXT))
    assert "\n" not in table(found).partition("\n")[2]


@given(LISTS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_saved_list_holds_parameters_and_nothing_else(
    tmp_path: Path, listed: list[dict[str, object]]
) -> None:
    """Keep a hostile robot from adding tables such as [network] to the file."""
    path = tmp_path / "p.toml"
    try:
        found = parameters_in(json.dumps(listed))
    except RemoteError:
        return
    unlike = {one.name: one.value for one in found if not one.is_default}
    names = parameter_file.write(path, found)
    assert tomllib.loads(path.read_text(encoding="utf-8")) == {"parameters": unlike}
    assert sorted(unlike) == sorted(names)


@given(TEXTS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_meaning_of_a_parameter_ends_its_comment(tmp_path: Path, doc: str) -> None:
    path = tmp_path / "p.toml"
    parameter_file.write(path, [Parameter(name="a", value=2.0, default=1.0, doc=doc)])
    assert tomllib.loads(path.read_text(encoding="utf-8")) == {"parameters": {"a": 2.0}}


ROWS_IN_FILE = [
    Parameter(name="d_obs_m", value=0.4, default=0.3, minimum=0.05, maximum=3.0, unit="m"),
    Parameter(name="side", value=1, default=1, minimum=-1, maximum=1),
]


def test_what_is_not_as_by_default_is_written_and_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    assert parameter_file.write(path, ROWS_IN_FILE) == ["d_obs_m"]
    assert tomllib.loads(path.read_text()) == {"parameters": {"d_obs_m": 0.4}}
    assert parameter_file.read(path, ROWS_IN_FILE) == ({"d_obs_m": 0.4}, ())


@each(
    ("name", "text"),
    [
        ("p.param", "D_OBS_M,0.4\n"),
        ("p.parm", "D_OBS_M,0.4\n"),
        ("p.params", "1\t1\tD_OBS_M\t0.4\t9\n"),
    ],
)
def test_file_of_a_ground_station_is_written_and_read(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    assert parameter_file.write(path, ROWS_IN_FILE) == ["d_obs_m"]
    assert path.read_text() == text
    assert parameter_file.read(path, ROWS_IN_FILE) == ({"d_obs_m": 0.4}, ())


@each(
    "text",
    [
        "\ufeff#NOTE: 1.12.2026\r\nD_OBS_M,0.4\r\nRCMAP_ROLL,1\r\n",
        "RCMAP_ROLL       1.000000\nD_OBS_M          0.400000  # far\n",
        "# Onboard parameters\n#\n1\t1\tD_OBS_M\t0.4\t9\n1\t1\tRCMAP_ROLL\t1\t4\n",
    ],
)
def test_parameters_of_ardupilot_are_left_out(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rover.param"
    path.write_text(text, encoding="utf-8")
    assert parameter_file.read(path, ROWS_IN_FILE) == ({"d_obs_m": 0.4}, ("RCMAP_ROLL",))


@each(
    ("text", "why"),
    [
        ("D_OBS_M,0,35", "p.param:1: D_OBS_M: '0,35' is not a number: write 0.35"),
        ("# far\nD_OBS_M 9", "p.param:2: D_OBS_M: 9 is out of range; give 0.05 to 3 m"),
        ("D_OBS_M nan", "p.param:1: D_OBS_M: is not finite; give a finite number"),
        ("D_OBS_M", "p.param:1: 'D_OBS_M' is not a name and a value; write NAME,VALUE"),
        ("RCMAP_ROLL 1", "p.param: has no parameter of this robot; see `sidestep param list`"),
    ],
)
def test_wrong_line_of_a_param_file_is_named(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "p.param"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        parameter_file.read(path, ROWS_IN_FILE)
    assert str(caught.value).endswith(why)


@each(
    ("text", "why"),
    [
        ("", "parameters: is missing; write"),
        ("[parameters]\nd_obs = 1", "parameters.d_obs: unknown key; did you mean 'd_obs_m'"),
        ("[parameters]\nd_obs_m = 'far'", "parameters.d_obs_m: is not a number"),
        ("[parameters]\nd_obs_m = true", "parameters.d_obs_m: is not a number"),
        ("[parameters]\nd_obs_m = 9", "9 is out of range; give 0.05 to 3 m"),
        ("[parameters]\nd_obs_m = nan", "nan is out of range"),
        ("[parameters", "correct the TOML syntax"),
    ],
)
def test_what_the_robot_cannot_have_is_refused_by_name(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "p.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=why.replace("[", r"\[")):
        parameter_file.read(path, ROWS_IN_FILE)


def test_unwritable_path_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such file"):
        parameter_file.write(tmp_path / "no" / "p.toml", ROWS_IN_FILE)


def test_single_precision_makes_no_difference() -> None:
    assert Parameter(name="a", value=0.30000001192, default=0.3).is_default
    assert Parameter(name="a", value=5).is_default


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


@each("words", ["", "nan", "inf", "-inf", "buggy"])
def test_word_that_is_no_value_is_an_error(words: str) -> None:
    with pytest.raises(UserError, match="must be a finite number or one of bug, vgm"):
        value_in_words("navigator", words)
    with pytest.raises(UserError, match=r"must be a finite number$"):
        value_in_words("d_obs_m", words)


def test_value_with_a_decimal_comma_shows_how_to_write_it() -> None:
    with pytest.raises(UserError, match=r"'0,4': must be a finite number, written as 0\.4$"):
        value_in_words("d_obs_m", "0,4")


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


@each("reason", [one for one in Reason if 0 < one < 30 or 100 <= one < 120])
def test_every_refusal_names_its_remedy(reason: Reason) -> None:
    assert (reason in HINTS or ": " in reason_text(reason)) != (reason in PLAIN)


def test_python_has_a_remedy_for_each_refusal_of_the_shell() -> None:
    assert SHELL.refusals.keys() <= PYTHON.refusals.keys()
    words = " ".join([*PYTHON.refusals.values(), *PYTHON[1:]])
    assert "--" not in words
    assert words.count("sidestep ") == words.count("`sidestep doctor` in a terminal") == 1


def test_every_cause_that_arming_does_not_lift_has_a_hint() -> None:
    assert {Reason.FENCE_BREACHED, Reason.FENCE_UNCHECKED} <= HINTS.keys()
