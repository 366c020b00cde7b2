"""The table of parameters, and safety parameters that change only while disarmed."""

import json
import re
from math import inf, nan
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.wire.enums import Command, Severity
from protocol.wire.messages import CommandAck, ParamSet
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS, Params
from robot.core.safety import guard
from robot.core.safety.failsafe import ROWS
from robot.parameter_table import (
    NEAR_SHARE,
    SPECS,
    TABLE,
    OutOfRangeError,
    ParameterSpec,
    SafetyBound,
    UnknownParameterError,
    adjusted,
    described,
    is_less_safe,
    with_value,
    with_values,
)
from robot.run import RobotSettings, parser, vehicle_of
from robot.storage import FILE_NAME, Store
from robot.vehicle import RobotVehicle
from runtime.errors import UserError
from tests.support.each import each
from tests.support.robots import Desk, armed


def test_every_setting_of_the_core_has_one_row_in_the_same_order() -> None:
    assert tuple(spec.name for spec in TABLE) == Params._fields


def test_every_default_is_within_its_own_range() -> None:
    for spec in TABLE:
        assert with_value(DEFAULTS, spec.name, spec.default) == DEFAULTS


def test_names_fit_a_mavlink_parameter_id() -> None:
    assert max(len(spec.name) for spec in TABLE) <= 16


def test_a_value_is_put_into_force_and_nothing_else_changes() -> None:
    changed = with_value(DEFAULTS, "d_obs_m", 0.45)
    assert changed.d_obs_m == 0.45
    assert with_value(changed, "d_obs_m", DEFAULTS.d_obs_m) == DEFAULTS


def test_several_values_are_put_into_force() -> None:
    changed = with_values(DEFAULTS, {"d_obs_m": 0.45, "side": -1.0})
    assert (changed.d_obs_m, changed.side) == (0.45, -1)


@each("bad", [{"d_obs_cm": 30.0}, {"d_obs_m": inf}])
def test_error_for_a_bad_value_contains_its_place(bad: dict[str, float]) -> None:
    with pytest.raises(UserError, match=r"^robot\.toml: .*d_obs_c?m"):
        adjusted(DEFAULTS, {"side": 1.0, **bad}, "robot.toml")


def test_an_unknown_name_is_named() -> None:
    with pytest.raises(UnknownParameterError, match="d_obs_cm"):
        with_value(DEFAULTS, "d_obs_cm", 30)


@each("value", [nan, inf, -inf, 0.0, 3.1, -1.0])
def test_values_outside_the_range_are_refused_with_the_range(value: float) -> None:
    with pytest.raises(OutOfRangeError, match=r"d_obs_m.*0\.05 to 3 m"):
        with_value(DEFAULTS, "d_obs_m", value)


def test_fraction_for_a_whole_number_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="whole number"):
        with_value(DEFAULTS, "stuck_ms", 2000.5)
    assert isinstance(with_value(DEFAULTS, "stuck_ms", 2000.0).stuck_ms, int)


def test_a_side_is_left_or_right() -> None:
    with pytest.raises(OutOfRangeError, match="one of 1, -1"):
        with_value(DEFAULTS, "side", 0)


@given(st.sampled_from(sorted(SPECS)), st.floats())
def test_accepted_values_are_within_their_range(name: str, value: float) -> None:
    try:
        changed = with_value(DEFAULTS, name, value)
    except OutOfRangeError:
        return
    assert SPECS[name].minimum <= getattr(changed, name) <= SPECS[name].maximum


def test_list_shows_unit_range_default_and_meaning() -> None:
    rows = described(with_value(DEFAULTS, "d_obs_m", 0.4))
    row = next(row for row in rows if row["name"] == "d_obs_m")
    assert (row["value"], row["default"], row["unit"]) == (0.4, 0.3, "m")
    assert (row["minimum"], row["maximum"], row["integer"]) == (0.05, 3.0, False)
    assert all(row["doc"] for row in rows)


WEAKER = (
    ("guard_stop_m", 0.0),
    ("op_lost_ms", 60_000.0),
    ("wheel_min_m_s", 1.0),
    ("freeze_m", 5.0),
    ("m_per_tick", 1e-6),
)
"""Parameters by which a review weakened a driving robot permanently."""

SAFER = {SafetyBound.UP: 1.01, SafetyBound.DOWN: 0.99, SafetyBound.NEAR: 1.01}
LESS_SAFE = {
    SafetyBound.UP: 0.99,
    SafetyBound.DOWN: 1.01,
    SafetyBound.NEAR: 1.0 + NEAR_SHARE + 0.01,
}
GROUP = [spec for spec in TABLE if spec.safer]


def put(desk: Desk, name: str, value: float) -> int:
    request = ParamSet(param_id=name, param_value=value, param_type=9)
    answer = desk.vehicle.receive(request, desk.now_ns)
    return answer.result_param2 if isinstance(answer, CommandAck) else Reason.NONE


def value_of(desk: Desk, name: str) -> float:
    return float(getattr(desk.vehicle.params, name))


def moved(name: str, by: float) -> float:
    """Return the default times a factor; whole for a whole-number parameter."""
    value = float(getattr(DEFAULTS, name)) * by
    return float(round(value)) if SPECS[name].integer else value


@each(("name", "value"), WEAKER)
def test_driving_robot_refuses_weaker_failsafes(name: str, value: float) -> None:
    desk = armed()
    desk.goto(3.0, 0.0)
    assert put(desk, name, value) == Reason.NOT_WHILE_ARMED
    assert desk.vehicle.params == DEFAULTS


@each(("name", "value"), WEAKER)
def test_disarmed_robot_refuses_weaker_failsafes(name: str, value: float) -> None:
    desk = Desk()
    desk.step()
    assert put(desk, name, value) == Reason.LESS_SAFE_THAN_CONFIGURED
    assert desk.vehicle.params == DEFAULTS


@each("name", [spec.name for spec in GROUP])
def test_safer_is_accepted_and_less_safe_refused(name: str) -> None:
    desk = Desk()
    safer = SPECS[name].safer
    assert put(desk, name, moved(name, LESS_SAFE[safer])) == Reason.LESS_SAFE_THAN_CONFIGURED
    assert put(desk, name, moved(name, SAFER[safer])) == Reason.NONE
    assert value_of(desk, name) == pytest.approx(moved(name, SAFER[safer]))
    assert put(desk, name, float(getattr(DEFAULTS, name))) == Reason.NONE, "back as configured"


@each("name", [spec.name for spec in GROUP])
def test_safety_parameters_change_only_while_disarmed(name: str) -> None:
    desk = armed()
    safer = moved(name, SAFER[SPECS[name].safer])
    assert put(desk, name, safer) == Reason.NOT_WHILE_ARMED
    assert put(desk, name, value_of(desk, name)) == Reason.NONE, "a repeated request is harmless"
    desk.command(Command.COMPONENT_ARM_DISARM, 0)
    assert put(desk, name, safer) == Reason.NONE


def test_all_other_parameters_change_under_way() -> None:
    desk = armed()
    for spec in TABLE:
        if not spec.safer:
            assert put(desk, spec.name, spec.default) == Reason.NONE
    assert put(desk, "v_max_m_s", 0.2) == Reason.NONE


def test_group_contains_all_that_guard_and_failsafes_use() -> None:
    """According to the failsafe table and the source of the guard."""
    source = Path(guard.__file__).read_text()
    named = {*re.findall(r"\w+", " ".join(row.limit for row in ROWS))}
    named |= set(re.findall(r"params\.(\w+)", source))
    assert {"guard_stop_m", "op_lost_ms", "freeze_rad", "wheel_share"} <= named
    assert named & SPECS.keys() <= {spec.name for spec in GROUP}


@given(st.sampled_from(GROUP), st.floats(1e-9, 1e9), st.floats(1e-9, 1e9))
def test_configured_values_are_never_less_safe(
    spec: ParameterSpec, limit: float, value: float
) -> None:
    configured = DEFAULTS._replace(**{spec.name: limit})  # type: ignore[arg-type]
    assert not is_less_safe(spec.name, limit, configured)
    assert not is_less_safe(spec.name, float(f"{limit:.7g}"), configured)
    if not is_less_safe(spec.name, value, configured):
        assert spec.safer is SafetyBound.DOWN or value >= 0.89 * limit
        assert spec.safer is SafetyBound.UP or value <= 1.11 * limit


# The configuration.


def started(state: Path, *words: str, settings: dict[str, float] | None = None) -> RobotVehicle:
    """Return the vehicle of a robot process with these arguments."""
    arguments = parser().parse_args(["--state", str(state), "--lockstep", *words])
    return vehicle_of(arguments, RobotSettings(parameters=settings or {}), Store(arguments.state))


def warnings(vehicle: RobotVehicle) -> str:
    return "".join(text.text for text in vehicle.texts() if text.severity == Severity.WARNING)


def test_configuration_may_be_weaker_than_the_default(tmp_path: Path) -> None:
    vehicle = started(tmp_path, settings={"op_lost_ms": 3000.0})
    assert vehicle.params.op_lost_ms == 3000
    desk = Desk()
    desk.vehicle = vehicle
    assert put(desk, "op_lost_ms", 2000.0) == Reason.NONE
    assert put(desk, "op_lost_ms", 3000.0) == Reason.NONE
    assert put(desk, "op_lost_ms", 3001.0) == Reason.LESS_SAFE_THAN_CONFIGURED


def test_saved_values_are_held_to_the_configuration(tmp_path: Path) -> None:
    """Load values saved by an older robot, or with another configuration."""
    weaker: dict[str, float] = dict(WEAKER)
    (tmp_path / FILE_NAME).write_text(json.dumps(weaker | {"d_obs_m": 0.4, "wheel_time_ms": 400}))
    vehicle = started(tmp_path)
    assert vehicle.params == DEFAULTS._replace(d_obs_m=0.4, wheel_time_ms=400)
    announced = warnings(vehicle)
    assert all(f"{name}: ignored" in announced for name in weaker)
    assert "op_lost_ms: ignored (60000 is less safe than configured, 1500)" in announced


def test_safe_saved_values_do_not_tighten_the_configuration(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text(json.dumps({"op_lost_ms": 800}))
    desk = Desk()
    desk.vehicle = started(tmp_path)
    assert desk.vehicle.params.op_lost_ms == 800
    assert put(desk, "op_lost_ms", 1500.0) == Reason.NONE


def test_command_line_is_part_of_the_configuration(tmp_path: Path) -> None:
    vehicle = started(tmp_path, "--param", "op_lost_ms=2500")
    assert vehicle.params.op_lost_ms == 2500
    (tmp_path / FILE_NAME).write_text(json.dumps({"op_lost_ms": 2400}))
    vehicle = started(tmp_path, "--param", "op_lost_ms=2500")
    assert vehicle.params.op_lost_ms == 2500
    assert warnings(vehicle) == ""


# Display.


def notices(desk: Desk) -> list[str]:
    whole = ""
    for text in desk.vehicle.texts():
        whole += text.text if text.severity == Severity.NOTICE else ""
    return [whole] if whole else []


def test_arming_lists_what_is_not_as_configured() -> None:
    desk = Desk()
    desk.step()
    put(desk, "op_lost_ms", 1000.0)
    put(desk, "guard_stop_m", 0.05)
    put(desk, "d_obs_m", 0.4)
    assert notices(desk) == []
    desk.arm()
    words = "armed with changed safety parameters: guard_stop_m 0.05 (0.04), op_lost_ms 1000 (1500)"
    assert notices(desk) == [words]
    desk.arm()
    assert notices(desk) == [], "it was armed before"


def test_arming_as_configured_lists_nothing() -> None:
    desk = armed()
    assert notices(desk) == []


def test_refused_arming_lists_nothing() -> None:
    desk = Desk()
    put(desk, "op_lost_ms", 1000.0)
    assert desk.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NO_SENSES
    assert notices(desk) == []


def test_list_shows_group_direction_and_configured_value() -> None:
    desk = Desk()
    put(desk, "op_lost_ms", 1000.0)
    rows = {row["name"]: row for row in json.loads(desk.vehicle.parameters.describe())}
    lost = rows["op_lost_ms"]
    shown = lost["group"], lost["direction"], lost["value"], lost["configured"]
    assert shown == ("safety", "down", 1000, 1500)
    assert (rows["track_m"]["group"], rows["track_m"]["direction"]) == ("safety", "near")
    assert (rows["d_obs_m"]["group"], rows["d_obs_m"]["direction"]) == ("", "")
