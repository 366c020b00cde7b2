from math import inf, nan

import pytest

from plant.model.configuration import Fault
from tests.support.each import each


def test_unknown_fault_is_rejected_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"^kind: no fault 'sonar_ded'; there are sonar_dead, "):
        Fault("sonar_ded", "0")


@each(("kind", "target"), [("sonar_dead", "8"), ("wheel_stuck", "0")])
def test_wrong_fault_target_is_rejected(kind: str, target: str) -> None:
    with pytest.raises(ValueError, match=f"^target: '{target}' is none of "):
        Fault(kind, target)


@each("start_s", [-1.0, nan, inf])
def test_fault_needs_a_start_time(start_s: float) -> None:
    with pytest.raises(ValueError, match=r"^start_s: "):
        Fault("scan_stopped", "", start_s)


@each("end_s", [1.0, 0.0, nan])
def test_fault_must_end_after_its_start(end_s: float) -> None:
    with pytest.raises(ValueError, match=r"^end_s: "):
        Fault("scan_stopped", "", 1.0, end_s)


@each("value", [nan, inf, -0.1, 1.1])
def test_fault_share_is_between_0_and_1(value: float) -> None:
    with pytest.raises(ValueError, match=r"^value: .* is not within 0 to 1 for wheel_slip"):
        Fault("wheel_slip", "left", value=value)


def test_negative_robot_of_a_fault_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^robot: "):
        Fault("scan_stopped", robot=-1)
