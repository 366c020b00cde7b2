from pathlib import Path

import pytest

from plant.model.configuration import LEVELS
from robot.core.parameters import DEFAULTS
from robot.parameter_table import SPECS, with_value
from runtime import config
from runtime.config import FOLDER, calibration_of, settings_of
from runtime.errors import ConfigError
from tests.support.each import each


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
