"""A parameter file holds the changed values; names a robot does not have are refused."""

import tomllib
from pathlib import Path

import pytest

from ground.client import parameter_file
from ground.client.parameter import Parameter
from runtime.errors import ConfigError, UserError

ROWS = [
    Parameter(name="d_obs_m", value=0.4, default=0.3, minimum=0.05, maximum=3.0, unit="m"),
    Parameter(name="side", value=1, default=1, minimum=-1, maximum=1),
]


def test_what_is_not_as_by_default_is_written_and_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    assert parameter_file.write(path, ROWS) == ["d_obs_m"]
    assert tomllib.loads(path.read_text()) == {"parameters": {"d_obs_m": 0.4}}
    assert parameter_file.read(path, ROWS) == {"d_obs_m": 0.4}


@pytest.mark.parametrize(
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
        parameter_file.read(path, ROWS)


def test_unwritable_path_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such file"):
        parameter_file.write(tmp_path / "no" / "p.toml", ROWS)


def test_single_precision_makes_no_difference() -> None:
    assert Parameter(name="a", value=0.30000001192, default=0.3).is_default
    assert Parameter(name="a", value=5).is_default
