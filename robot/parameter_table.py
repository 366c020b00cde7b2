"""The table of the robot's parameters, with unit, range and meaning.

The safety group contains the parameters that guard and failsafes depend on, including the geometry
that the pose is computed from. An operator may change these only while the robot is disarmed. The
new values must be at least as safe as the configuration, which is the file and the command line at
the start.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from types import MappingProxyType
from typing import Final

from protocol.wire.enums import Navigator
from robot.core import states
from robot.core.navigators.registry import NAVIGATORS
from robot.core.parameters import DEFAULTS, Params
from runtime.errors import UserError


class SafetyBound(StrEnum):
    """The direction in which values of a safety parameter are as safe as the configured one."""

    NONE = ""
    """Any value: the parameter is not in the safety group."""
    UP = "up"
    DOWN = "down"
    NEAR = "near"
    """Values within `NEAR_SHARE` of it: a dimension of the robot that a calibration refines."""


NEAR_SHARE: Final = 0.1
ROUNDING: Final = 1e-6
"""Tolerance of comparisons, because values arrive as float32."""


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """Unit, range and meaning of one parameter.

    `choices` are the allowed values, empty for all in the range. `safer` is not NONE in the safety
    group.
    """

    name: str
    unit: str
    minimum: float
    maximum: float
    doc: str
    safer: SafetyBound = SafetyBound.NONE
    choices: Collection[int] = ()

    @property
    def group(self) -> str:
        """Name of the group: `safety` or empty."""
        return "safety" if self.safer else ""

    @property
    def default(self) -> float:
        """Default value."""
        return float(getattr(DEFAULTS, self.name))

    @property
    def integer(self) -> bool:
        """True for a parameter with whole numbers."""
        return isinstance(getattr(DEFAULTS, self.name), int)


UP, DOWN, NEAR = SafetyBound.UP, SafetyBound.DOWN, SafetyBound.NEAR
TABLE: Final = (
    ParameterSpec("radius_m", "m", 0.02, 1.0, "radius of the robot", UP),
    ParameterSpec("track_m", "m", 0.02, 2.0, "distance between the wheels (the paper's l)", NEAR),
    ParameterSpec("wheel_radius_m", "m", 0.005, 0.5, "wheel radius", NEAR),
    ParameterSpec(
        "wheel_ratio", "", 0.8, 1.25, "diameter of the right wheel over that of the left", NEAR
    ),
    ParameterSpec("m_per_tick", "m", 1e-6, 0.05, "distance a wheel rolls per encoder tick", NEAR),
    ParameterSpec("wheel_max_m_s", "m/s", 0.01, 3.0, "fastest rim speed of a wheel", DOWN),
    ParameterSpec("v_max_m_s", "m/s", 0.01, 3.0, "fastest forward speed"),
    ParameterSpec("yaw_max_rad_s", "rad/s", 0.1, 10.0, "fastest turn"),
    ParameterSpec("accel_m_s2", "m/s^2", 0.05, 10.0, "strongest acceleration of a wheel", UP),
    ParameterSpec("period_s", "s", 0.05, 0.05, "control period; fixed"),
    ParameterSpec("k_r_m", "m", 0.0, 0.01, "odometry error of the right wheel, variance per metre"),
    ParameterSpec("k_l_m", "m", 0.0, 0.01, "odometry error of the left wheel, variance per metre"),
    ParameterSpec("sonar_max_m", "m", 0.2, 60.0, "farthest range of a sonar", DOWN),
    ParameterSpec(
        "sonar_stale_ms", "ms", 25, 1000, "a ping older than this counts as missing", DOWN
    ),
    ParameterSpec(
        "freeze_m", "m", 0.01, 5.0, "driven so far with unchanged echoes: sonar frozen", DOWN
    ),
    ParameterSpec(
        "freeze_rad", "rad", 0.01, 6.3, "turned so far with unchanged echoes: sonar frozen", DOWN
    ),
    ParameterSpec(
        "freeze_front_m", "m", 0.1, 60.0, "an unchanged echo counts as frozen up to this range", UP
    ),
    ParameterSpec(
        "navigator",
        "",
        min(Navigator),
        max(Navigator),
        "navigator: " + ", ".join(f"{one.value} {one.name.lower()}" for one in Navigator),
        choices=NAVIGATORS.keys(),
    ),
    ParameterSpec(
        "side",
        "",
        states.RIGHT,
        states.LEFT,
        f"obstacles are passed on: {states.LEFT} left, {states.RIGHT} right",
        choices=(states.LEFT, states.RIGHT),
    ),
    ParameterSpec(
        "d_obs_m",
        "m",
        0.05,
        3.0,
        "width of the avoidance zone of vgm (the paper's d_obs); for all, what is near at a goal",
    ),
    ParameterSpec("d_th_m", "m", 0.05, 3.0, "threshold distance of bug (the paper's d_th)"),
    ParameterSpec("follow_m", "m", 0.05, 1.0, "distance at which bug follows a boundary"),
    ParameterSpec("k_rho", "1/m", 0.1, 20.0, "position controller: gain on distance"),
    ParameterSpec("k_omega", "1/s", 0.1, 20.0, "position controller: gain on bearing"),
    ParameterSpec("pose_k_rho", "1/m", 0.1, 20.0, "pose controller: gain on distance"),
    ParameterSpec("pose_k_omega", "1/s", 0.1, 20.0, "pose controller: gain on bearing"),
    ParameterSpec("pose_h", "", 0.0, 20.0, "pose controller: weight of the final heading"),
    ParameterSpec("pose_from_m", "m", 0.0, 10.0, "pose controller steers from this distance on"),
    ParameterSpec("align_k", "1/s", 0.1, 20.0, "last turn on the spot: gain"),
    ParameterSpec("align_min_rad_s", "rad/s", 0.01, 1.0, "last turn on the spot: slowest turn"),
    ParameterSpec("spin_room_m", "m", 0.0, 1.0, "with less room ahead the robot turns on the spot"),
    ParameterSpec("goal_max_m", "m", 1.0, 10_000.0, "farthest coordinate of a goal"),
    ParameterSpec(
        "guard_stop_m", "m", 0.0, 1.0, "guard: no forward motion below this range; 0 is off", UP
    ),
    ParameterSpec(
        "guard_time_s", "s", 0.05, 5.0, "guard: time to cover the range that is left", UP
    ),
    ParameterSpec("op_lost_ms", "ms", 200, 60_000, "operator lost after this silence", DOWN),
    ParameterSpec("wheel_min_m_s", "m/s", 0.01, 1.0, "wheel stuck: judged above this speed", DOWN),
    ParameterSpec("wheel_time_ms", "ms", 100, 10_000, "wheel stuck: judged over this time", DOWN),
    ParameterSpec("wheel_share", "", 0.01, 0.9, "wheel stuck: turned less than this share", UP),
    ParameterSpec("stuck_ms", "ms", 1000, 600_000, "blocked: hardly moved for this long"),
    ParameterSpec("stuck_m", "m", 0.005, 1.0, "blocked: moved less than this"),
    ParameterSpec("stuck_rad", "rad", 0.01, 6.3, "blocked: turned less than this"),
    ParameterSpec("progress_ms", "ms", 1000, 3_600_000, "no progress: no closer for this long"),
    ParameterSpec("progress_m", "m", 0.005, 1.0, "no progress: closer by at least this counts"),
)

SPECS: Final = MappingProxyType({spec.name: spec for spec in TABLE})
SPEEDS: Final = ("v_max_m_s", "yaw_max_rad_s")
"""Not in the safety group, because they may change under way within `wheel_max_m_s`."""


class UnknownParameterError(LookupError):
    """There is no parameter of this name."""


class OutOfRangeError(ValueError):
    """The value is not finite, not whole where required, or outside its range."""


def with_value(params: Params, name: str, value: float) -> Params:
    """Return a copy of the parameters with one value changed.

    Raises UnknownParameterError or OutOfRangeError, whose text names the parameter and the problem.
    """
    spec = SPECS.get(name)
    if spec is None:
        raise UnknownParameterError(f"there is no parameter «{name}»")
    if not isfinite(value) or not spec.minimum <= value <= spec.maximum:
        limits = f"{spec.minimum:g} to {spec.maximum:g} {spec.unit}".rstrip()
        raise OutOfRangeError(f"{name} = {value:g}: must be within {limits}")
    if spec.integer and value != int(value):
        raise OutOfRangeError(f"{name} = {value:g}: must be a whole number")
    if spec.choices and value not in spec.choices:
        raise OutOfRangeError(
            f"{name} = {value:g}: must be one of {', '.join(map(str, spec.choices))}"
        )
    values = list(params)
    values[params._fields.index(name)] = int(value) if spec.integer else value
    return Params._make(values)


def with_values(params: Params, values: Mapping[str, float]) -> Params:
    """Return a copy of the parameters with several values changed, as `with_value` does."""
    for name, value in values.items():
        params = with_value(params, name, value)
    return params


def adjusted(params: Params, values: Mapping[str, float], where: str) -> Params:
    """Return parameters with several changed; raise UserError that contains `where`."""
    try:
        return with_values(params, values)
    except (UnknownParameterError, OutOfRangeError) as error:
        raise UserError(f"{where}: {error}") from None


def concerns_safety(name: str) -> bool:
    """Return whether a lost value may make the robot less safe: the safety group, and speeds."""
    spec = SPECS.get(name)
    return spec is not None and (bool(spec.safer) or name in SPEEDS)


def is_less_safe(name: str, value: float, configured: Params) -> bool:
    """Return whether a value is less safe than the configured one."""
    limit = float(getattr(configured, name))
    slack = ROUNDING * abs(limit)
    match SPECS[name].safer:
        case SafetyBound.UP:
            return value < limit - slack
        case SafetyBound.DOWN:
            return value > limit + slack
        case SafetyBound.NEAR:
            return abs(value - limit) > NEAR_SHARE * abs(limit) + slack
        case _:
            return False


def described(
    params: Params, configured: Params | None = None
) -> list[dict[str, float | bool | str]]:
    """Return all parameters in table order, each with value, default, unit, range and doc.

    `direction` is the safer direction of a parameter in the safety group.
    """
    configured = params if configured is None else configured
    return [
        {
            "name": spec.name,
            "value": getattr(params, spec.name),
            "default": spec.default,
            "unit": spec.unit,
            "minimum": spec.minimum,
            "maximum": spec.maximum,
            "integer": spec.integer,
            "doc": spec.doc,
            "group": spec.group,
            "direction": str(spec.safer),
            "configured": getattr(configured, spec.name),
        }
        for spec in TABLE
    ]
