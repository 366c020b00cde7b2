"""Noise levels of sensors and wheels, by name."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isfinite, pi, radians
from types import MappingProxyType
from typing import Final


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """One level of noise; the default values are no noise.

    A range has a Gaussian error of `range_sigma_m + range_sigma_ratio * range`. An echo is lost
    with `dropout_probability`, comes too early with `ghost_probability`, and never comes from a
    surface met more obliquely than `incidence_limit_rad`. Each wheel slips with a variance of
    `slip_variance_m` square metres per metre; the right wheel is larger than the left by
    `diameter_difference_ratio`.

    Raises ValueError, naming the field, for a value out of its range.
    """

    range_sigma_m: float = 0.0
    range_sigma_ratio: float = 0.0
    dropout_probability: float = 0.0
    ghost_probability: float = 0.0
    incidence_limit_rad: float = pi / 2
    slip_variance_m: float = 0.0
    diameter_difference_ratio: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, limit = getattr(self, field.name), UPPER_LIMITS[field.name]
            lowest = -limit if field.name == "diameter_difference_ratio" else 0.0
            if not isfinite(value) or not lowest <= value <= limit:
                raise ValueError(f"{field.name}: {value} is not within {lowest:g} to {limit:g}")


UPPER_LIMITS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "range_sigma_m": 1.0,
        "range_sigma_ratio": 1.0,
        "dropout_probability": 1.0,
        "ghost_probability": 1.0,
        "incidence_limit_rad": pi / 2,
        "slip_variance_m": 0.01,
        "diameter_difference_ratio": 0.2,
    }
)

LEVELS: Final[Mapping[str, Noise]] = MappingProxyType(
    {
        "none": Noise(),
        "default": Noise(
            range_sigma_m=0.003,
            range_sigma_ratio=0.01,
            dropout_probability=0.005,
            ghost_probability=0.001,
            slip_variance_m=2e-6,
        ),
        "lossy": Noise(
            range_sigma_m=0.003,
            range_sigma_ratio=0.01,
            dropout_probability=0.005,
            ghost_probability=0.001,
            incidence_limit_rad=radians(40.0),
            slip_variance_m=2e-6,
        ),
        "harsh": Noise(
            range_sigma_m=0.010,
            range_sigma_ratio=0.02,
            dropout_probability=0.03,
            ghost_probability=0.01,
            incidence_limit_rad=radians(40.0),
            slip_variance_m=2e-5,
            diameter_difference_ratio=0.005,
        ),
    }
)
