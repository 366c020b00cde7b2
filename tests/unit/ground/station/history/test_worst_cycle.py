"""Of the control cycles of a second the dearest is shown, and an expensive one at once."""

from dataclasses import dataclass

import pytest

from ground.station.history.telemetry_history import WorstCycle
from protocol.wire.messages import CycleReport
from tests.support.ground.station.play import Play
from tests.support.ground.station.said import Robot


def cycle(spent_us: int, tick: int = 0) -> CycleReport:
    return CycleReport(
        time_ns=0, tick=tick, missed=0, overruns=0, rejected=0, late_us=0, sense_age_us=0,
        budget_us=2500, stage_us=(spent_us, 0, 0, 0, 0),
    )  # fmt: skip


def shown(*spent: tuple[float, int]) -> list[int]:
    """What is shown after each cycle of some time and cost."""
    dearest, found = WorstCycle(), []
    for time_s, spent_us in spent:
        dearest.add(cycle(spent_us), time_s)
        assert dearest.cycle is not None
        found.append(sum(dearest.cycle.stage_us))
    return found


def test_within_a_second_only_a_dearer_one_changes_what_is_shown() -> None:
    assert shown((0.0, 30), (0.2, 20), (0.4, 40), (0.6, 35)) == [30, 30, 40, 40]


def test_when_a_second_is_over_its_dearest_is_shown_until_the_next_is() -> None:
    assert shown((0.0, 90), (1.0, 20), (1.5, 30), (2.0, 10), (2.5, 25), (3.0, 5)) == [
        90, 90, 90, 30, 30, 25,
    ]  # fmt: skip


def test_after_a_silence_nothing_from_before_it_is_shown() -> None:
    assert shown((0.0, 90), (5.0, 20)) == [90, 20]


def test_before_the_first_there_is_none() -> None:
    assert WorstCycle().cycle is None


@dataclass
class Jittery(Robot):
    """Its cycles cost between 15 and 24 us."""

    def cycle(self) -> CycleReport:
        return cycle(15 + self.tick % 10, self.tick)


@pytest.mark.parametrize("seconds", [2.0, 5.0])
def test_what_is_shown_of_a_standing_robot_stays_the_same(seconds: float) -> None:
    play = Play()
    play.robots = [Jittery()]
    play.forward(1.0)
    first = play.station.dearest_cycle
    assert first is not None
    assert sum(first.stage_us) == 24
    for _ in range(round(seconds * 20)):
        play.forward(0.05)
        found = play.station.dearest_cycle
        assert found is not None
        assert sum(found.stage_us) == 24


def test_a_robot_that_begins_anew_begins_with_its_own_cycles() -> None:
    play = Play()
    play.robots = [Jittery()]
    play.forward(2.0)
    play.robots = [Robot()]
    play.forward(0.05)
    found = play.station.dearest_cycle
    assert found is not None
    assert sum(found.stage_us) == 15
