"""Settings and data from files: errors with key and fix, at any depth or length."""

import json
import tomllib
from dataclasses import dataclass, field, fields
from math import inf
from pathlib import Path
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

from plant.model.configuration import LEVELS, Body
from protocol.bus.network import Network
from robot.core.parameters import DEFAULTS, Params
from robot.parameter_table import SPECS, with_value
from runtime import config
from runtime.config import (
    FOLDER,
    RENAMED,
    SAME,
    calibration_of,
    load,
    load_shared,
    parameters_of,
    parse,
    settings_of,
)
from runtime.errors import ConfigError, LocalError
from runtime.files import MAX_DEPTH, value_in
from runtime.toml_reader import TooDeepError, key_lines
from tests.support.each import each


@dataclass(frozen=True, kw_only=True)
class Robot:
    id: str
    rate_hz: Annotated[float, Meta(ge=1.0, le=100.0)] = 20.0
    gain: float = 1.0
    network: Network = field(default_factory=Network)


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_becomes_typed_settings(tmp_path: Path) -> None:
    text = """
    id = "r2"
    rate_hz = 10
    [network]
    mode = "client"
    connect = ["tcp/127.0.0.1:7447"]
    """
    robot = load(written(tmp_path, text), Robot)
    network = Network(mode="client", connect=("tcp/127.0.0.1:7447",))
    assert robot == Robot(id="r2", rate_hz=10.0, network=network)


@each(
    ("text", "key", "words"),
    [
        ('id = "r"\nrate_h = 3', "rate_h", "unknown key; did you mean 'rate_hz'?"),
        ('id = "r"\nzzz = 3', "zzz", "unknown key; known keys: gain, id, network, rate_hz"),
        ('id = "r"\n[network]\nmod = "peer"', "network.mod", "did you mean 'mode'?"),
        ("", "id", "missing key; add it"),
        ("id = 3", "id", "expected `str`, got `int`"),
        ('id = "r"\nrate_hz = 200', "rate_hz", "expected `float` <= 100"),
        ('id = "r"\nrate_hz = true', "rate_hz", "expected `float`, got `bool`"),
        ('id = "r"\ngain = 1,5', "", "'1,5' is not a number: write 1.5 (at line 2); correct"),
        ('id = "r"\ngain = nan', "gain", "is not finite; give a finite number"),
        ('id = "r"\ngain = -inf', "gain", "is not finite"),
        ('id = "r"\nnetwork = 3', "network", "expected `object`, got `int`"),
        ('id = "r"\n[network]\nmode = "pear"', "network.mode", "'client', 'peer', 'router'"),
        ('id = "r"\n[network]\nlisten = ["banana"]', "network", "endpoint 'banana': write it as"),
        ("id = ", "", "Invalid value"),
    ],
)
def test_a_mistake_is_named_with_file_key_reason_and_fix(
    tmp_path: Path, text: str, key: str, words: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load(path, Robot)
    assert caught.value.key == key
    assert caught.value.file == str(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there_is_named() -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml: no such file"):
        load("nowhere.toml", Robot)


def test_a_file_that_is_not_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load(path, Robot)


def test_a_configuration_error_is_the_users_and_ends_with_code_2() -> None:
    with pytest.raises(LocalError) as caught:
        parse({"robot": 1}, Robot, file="x.toml")
    assert isinstance(caught.value, ConfigError)
    assert caught.value.exit_code == 2


@dataclass(frozen=True, kw_only=True)
class OnlyNetwork:
    network: Network | None = None


def test_keys_of_other_processes_in_a_shared_file_are_ignored(tmp_path: Path) -> None:
    text = 'robot = 3\n[network]\nprefix = "a"\n[parameters]\nfoo = 1'
    found = load_shared(written(tmp_path, text), OnlyNetwork)
    assert found.network == Network(prefix="a")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[paramters]", "paramters: unknown key; did you mean 'parameters'?"),
        ("zzz = 1", "zzz: unknown key; known keys: gateway, network, parameters, robot"),
        ('[network]\nmod = "peer"', "network.mod: unknown key; did you mean 'mode'?"),
    ],
)
def test_in_a_shared_file_a_misspelt_name_is_still_refused(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        load_shared(written(tmp_path, text), OnlyNetwork)
    assert words in str(caught.value)


TEXT = '''# a comment with [[obstacle]] in it
name = "a # no comment"   # but this is one

size_m = [
  6.0,
  4.0, # the depth
]
start = { x_m = 1.5, heading_deg = 0 }
doc = """
[not_a_table]
x = 1
"""
[robot]
radius_m = 0.12
[[obstacle]]
circle_m = { x = 1,
  y = 2 }

[[obstacle]]
[obstacle.circle_m]
x = 3
[after."quoted key"]
deep.er = 1
'''.replace("x = 1,\n  y", "x = 1, y")  # inline tables stay on one line


def test_each_key_is_found_on_its_line() -> None:
    lines = key_lines(TEXT)
    assert lines[("name",)] == 2
    assert lines[("size_m",)] == 4
    assert lines[("size_m", 1)] == 6
    assert lines[("start", "heading_deg")] == 8
    assert lines[("doc",)] == 9
    assert lines[("robot", "radius_m")] == 14


def test_the_nth_table_of_a_list_has_its_own_lines() -> None:
    lines = key_lines(TEXT)
    assert lines[("obstacle", 0)] == 15
    assert lines[("obstacle", 0, "circle_m", "y")] == 16
    assert lines[("obstacle", 1)] == 18
    assert lines[("obstacle", 1, "circle_m", "x")] == 20


def test_quoted_and_dotted_keys_are_found() -> None:
    assert key_lines(TEXT)[("after", "quoted key", "deep", "er")] == 22


def test_what_only_looks_like_a_key_is_not_one() -> None:
    assert not any("not_a_table" in key for key in key_lines(TEXT))


def test_an_empty_text_has_no_keys() -> None:
    assert key_lines("") == {}


scalars = st.one_of(
    st.integers(-1000, 1000).map(str), st.floats(-9, 9).map(lambda x: f"{x:.3f}"), st.just("true")
)
names = st.text("abcdefgh_", min_size=1, max_size=6)
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3).map(lambda parts: f"[{', '.join(parts)}]")
)


@given(st.dictionaries(names, values, max_size=8))
def test_a_flat_file_has_one_key_per_line(table: dict[str, str]) -> None:
    text = "\n".join(f"{name} = {value}" for name, value in table.items())
    lines = key_lines(text)
    assert set(tomllib.loads(text)) == {key[0] for key in lines}
    assert [lines[(name,)] for name in table] == list(range(1, len(table) + 1))


@given(st.text("[]{}=.,\"'#\n ab1", max_size=60))
def test_even_nonsense_is_scanned_to_its_end(text: str) -> None:
    assert all(1 <= line <= text.count("\n") + 1 for line in key_lines(text).values())


def test_lists_nested_too_deeply_are_refused() -> None:
    with pytest.raises(TooDeepError, match="nested too deeply"):
        key_lines("a = " + "[" * 100_000)


def nested(depth: int, opens: str = "[", closes: str = "]") -> str:
    return opens * depth + closes * depth


def test_valid_json_is_read() -> None:
    assert value_in('{"a": [1, 2.5, "x", null]}') == {"a": [1, 2.5, "x", None]}
    assert value_in(b"3") == 3
    assert value_in("1" * 19) == float("1" * 19)
    assert value_in("9" * 400) == inf


@each("depth", [MAX_DEPTH + 1, 900, 5000, 100_000])
def test_too_deep_nesting_is_refused(depth: int) -> None:
    """Refuse it even if the parser accepts it, because a writer would not."""
    with pytest.raises(ValueError, match="nested too deeply"):
        value_in(nested(depth))
    with pytest.raises(ValueError, match="nested too deeply"):
        value_in(nested(depth, '{"a":', "}").replace(":}", ":1}"))


def test_nesting_at_the_limit_is_read() -> None:
    value = value_in(nested(MAX_DEPTH))
    assert json.dumps(value) == nested(MAX_DEPTH)


@each("text", ["", "{", b"\xff\xfe", "nonsense", b"\x00"])
def test_invalid_json_is_a_value_error(text: str | bytes) -> None:
    with pytest.raises(ValueError, match=r"Expecting|decode|codec"):
        value_in(text)


UNKNOWN_TO_THE_ROBOT = {
    "brake_m_s2",
    "motor_lag_s",
    "left_start_ticks",
    "right_start_ticks",
    "sonar_min_m",
}


def test_without_a_table_nothing_is_overridden() -> None:
    assert parameters_of({}) == {}


def test_changed_dimensions_become_parameters() -> None:
    values = parameters_of({"track_m": 0.16, "max_speed_m_s": 0.5, "ticks_per_m": 4000})
    assert values == {
        "track_m": 0.16,
        "wheel_max_m_s": 0.5,
        "v_max_m_s": 0.5,
        "m_per_tick": 1 / 4000,
    }


def test_every_dimension_is_passed_on_or_listed_as_not() -> None:
    known = {*SAME, *RENAMED, "ticks_per_m"}
    assert known | UNKNOWN_TO_THE_ROBOT == {field.name for field in fields(Body)}
    assert not known & UNKNOWN_TO_THE_ROBOT


def test_default_robots_of_plant_and_core_are_equal() -> None:
    body = Body()
    passed_on = {*SAME, *RENAMED, "ticks_per_m"}
    table = {name: getattr(body, name) for name in passed_on}
    for name, value in parameters_of(table).items():
        assert name in Params._fields
        assert getattr(DEFAULTS, name) == value


@each("level", LEVELS)
def test_every_noise_level_has_a_valid_calibration(
    level: str,
) -> None:
    for name, value in calibration_of(level).items():
        assert with_value(DEFAULTS, name, value) != DEFAULTS
        assert name in SPECS
    made_by = (FOLDER / f"{level}.toml").read_text(encoding="utf-8").splitlines()[0]
    assert made_by.startswith(f"# Made by: sidestep calibrate --noise {level} --runs ")


def test_robot_defaults_fit_the_default_noise() -> None:
    assert calibration_of("default") == calibration_of("lossy") == {}


def test_without_noise_wheels_do_not_slip() -> None:
    assert calibration_of("none") == {"k_r_m": 0.0, "k_l_m": 0.0}


def test_harsh_noise_has_the_wheels_the_plant_gives_it() -> None:
    found = calibration_of("harsh")
    half = LEVELS["harsh"].diameter_difference_ratio / 2
    assert found["wheel_ratio"] == pytest.approx((1 + half) / (1 - half), abs=3e-4)
    assert found["k_r_m"] == pytest.approx(LEVELS["harsh"].slip_variance_m, rel=0.15)


def test_the_worlds_own_robot_comes_after_its_calibration() -> None:
    told = settings_of({"track_m": 0.17}, "harsh", calibrated=True)
    assert told == {**calibration_of("harsh"), "track_m": 0.17}
    assert settings_of({"track_m": 0.17}, "harsh", calibrated=False) == {"track_m": 0.17}


def test_missing_calibration_is_an_error_with_the_file() -> None:
    with pytest.raises(ConfigError, match=r"gale\.toml: no such file"):
        calibration_of("gale")


def test_a_misspelt_file_is_refused_by_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "typo.toml").write_text("[parameter]\nk_r_m = 1e-6\n", encoding="utf-8")
    monkeypatch.setattr(config, "FOLDER", tmp_path)
    with pytest.raises(ConfigError, match="parameter: unknown key"):
        calibration_of("typo")


def test_shared_calibration_is_read_only() -> None:
    with pytest.raises(TypeError):
        calibration_of("harsh")["k_r_m"] = 1.0  # type: ignore[index]
