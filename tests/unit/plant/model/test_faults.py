from math import inf, nan

import pytest

from plant.model.faults import Fault


def test_an_unknown_fault_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match=r"^kind: no fault 'sonar_ded'; there are sonar_dead, "):
        Fault("sonar_ded", "0")


@pytest.mark.parametrize(("kind", "target"), [("sonar_dead", "8"), ("wheel_stuck", "0")])
def test_a_wrong_target_is_refused(kind: str, target: str) -> None:
    with pytest.raises(ValueError, match=f"^target: '{target}' is none of "):
        Fault(kind, target)


@pytest.mark.parametrize("start_s", [-1.0, nan, inf])
def test_a_fault_starts_at_a_time(start_s: float) -> None:
    with pytest.raises(ValueError, match=r"^start_s: "):
        Fault("scan_stopped", "", start_s)


@pytest.mark.parametrize("end_s", [1.0, 0.0, nan])
def test_a_fault_ends_after_its_start(end_s: float) -> None:
    with pytest.raises(ValueError, match=r"^end_s: "):
        Fault("scan_stopped", "", 1.0, end_s)


@pytest.mark.parametrize("value", [nan, inf, -0.1, 1.1])
def test_a_share_is_between_none_and_all(value: float) -> None:
    with pytest.raises(ValueError, match=r"^value: .* is not within 0 to 1 for wheel_slip"):
        Fault("wheel_slip", "left", value=value)


def test_a_robot_has_a_number() -> None:
    with pytest.raises(ValueError, match=r"^robot: "):
        Fault("scan_stopped", robot=-1)
