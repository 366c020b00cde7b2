from dataclasses import astuple, fields
from math import inf, nan, pi, radians

import pytest

from plant.model.configuration import LEVELS, Noise
from tests.support.each import each


def test_noise_has_four_levels() -> None:
    assert list(LEVELS) == ["none", "default", "lossy", "harsh"]


def test_level_none_has_no_noise() -> None:
    assert astuple(LEVELS["none"]) == (0.0, 0.0, 0.0, 0.0, pi / 2, 0.0, 0.0)


def test_level_lossy_is_default_without_grazing_echoes() -> None:
    default, lossy = astuple(LEVELS["default"]), astuple(LEVELS["lossy"])
    assert default == (0.003, 0.01, 0.005, 0.001, pi / 2, 2e-6, 0.0)
    assert lossy == (*default[:4], radians(40.0), *default[5:])


def test_level_harsh_has_fixed_values() -> None:
    assert astuple(LEVELS["harsh"]) == (0.01, 0.02, 0.03, 0.01, radians(40.0), 2e-5, 0.005)


@each("name", [field.name for field in fields(Noise)])
@each("value", [nan, inf, -inf, -0.3, 2.0])
def test_value_out_of_range_is_rejected_by_name(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        Noise(**{name: value})
