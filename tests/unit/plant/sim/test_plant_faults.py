from math import inf

import pytest

from plant.model.configuration import KINDS, LEVELS, Fault
from plant.sim.simulation import Plant
from tests.support.each import each
from tests.support.plant.rooms import NONE, bumper, counters, drive, ranges_m, room


def plant(*faults: Fault) -> Plant:
    return Plant(room(), 1, NONE, faults)


@each("kind", sorted(KINDS))
def test_every_fault_takes_effect_and_ends(kind: str) -> None:
    spec = KINDS[kind]
    fault = Fault(kind, spec.targets[-1], 0.5, 1.0, spec.highest)
    sound, faulty = plant(), plant(fault)
    differs = []
    for _ in range(30):
        drive(sound, 0.2, 0.1, 1)
        drive(faulty, 0.2, 0.1, 1)
        differs.append(sound.senses() != faulty.senses() or sound.truth() != faulty.truth())
    assert not any(differs[:9])
    assert any(differs[9:20])
    lasting = {"encoder_stuck", "encoder_jump", "wheel_slip", "wheel_stuck"}
    assert differs[-1] == (kind in lasting)


@each(("kind", "index"), [("ticks_stopped", 0), ("scan_stopped", 1)])
def test_stopped_senses_are_none_and_resume(kind: str, index: int) -> None:
    one = plant(Fault(kind, "", 0.1, 0.2))
    missing = []
    for _ in range(6):
        senses = one.senses()
        missing.append(senses[index] is None)
        assert senses[1 - index] is not None
        one.advance()
    assert missing == [False, False, True, True, False, False]


def test_fault_may_be_active_from_the_start() -> None:
    assert plant(Fault("scan_stopped")).senses()[1] is None


def test_stuck_bumper_is_pressed_without_a_contact() -> None:
    one = plant(Fault("bumper_stuck", value=5))
    assert bumper(one) == 5
    one.advance()
    assert one.truth().contact == 0


def test_encoder_jumps_once() -> None:
    one = plant(Fault("encoder_jump", "left", 0.1, inf, 5000))
    left = []
    for _ in range(4):
        left.append(counters(one)[0])
        one.advance()
    assert left == [0, 0, 5000, 5000]


def test_stuck_wheel_turns_the_robot() -> None:
    one = plant(Fault("wheel_stuck", "left"))
    drive(one, 0.2, 0.2, 20)
    assert one.truth().heading_rad > 0.5
    assert counters(one)[0] == 0


def test_encoder_does_not_measure_wheel_slip() -> None:
    one = plant(Fault("wheel_slip", "right", value=0.5))
    drive(one, 0.2, 0.2, 20)
    assert one.truth().heading_rad < -0.3
    assert counters(one)[0] == counters(one)[1]


def test_injected_fault_acts_from_the_next_period_until_cleared() -> None:
    one = plant()
    one.inject(Fault("sonar_dropout", "all", value=1.0))
    assert ranges_m(one)[0] is not None
    one.advance()
    assert ranges_m(one) == [None] * 8
    one.clear_faults()
    one.advance()
    assert ranges_m(one)[0] is not None


def test_fault_affects_only_its_robot() -> None:
    pair = Plant(room(), 1, NONE, [Fault("scan_stopped", robot=1)], robots=2)
    assert pair.senses(0)[1] is not None
    assert pair.senses(1)[1] is None


def test_fault_of_an_absent_robot_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^robot: 1 has a fault"):
        plant(Fault("scan_stopped", robot=1))
    with pytest.raises(ValueError, match=r"^robot: 2 has a fault"):
        plant().inject(Fault("scan_stopped", robot=2))


def test_fault_does_not_shift_other_noise() -> None:
    """Leave the readings of the other sonars unchanged by a fault of one."""
    sound = Plant(room(), 4, LEVELS["harsh"])
    faulty = Plant(room(), 4, LEVELS["harsh"], [Fault("sonar_dropout", "0", value=0.5)])
    for _ in range(50):
        drive(sound, 0.2, 0.2, 1)
        drive(faulty, 0.2, 0.2, 1)
        assert ranges_m(sound)[1:] == ranges_m(faulty)[1:]
