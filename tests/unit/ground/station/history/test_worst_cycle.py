"""The most expensive control cycle of each second is shown, and a new one at once."""

from dataclasses import dataclass

from ground.station.history.telemetry_history import WorstCycle
from protocol.wire.messages import CycleReport
from tests.support.each import each
from tests.support.ground.station.play import Play
from tests.support.ground.station.said import Robot


def cycle(spent_us: int, tick: int = 0) -> CycleReport:
    return CycleReport(
        time_ns=0, tick=tick, missed=0, overruns=0, rejected=0, late_us=0, sense_age_us=0,
        budget_us=2500, stage_us=(spent_us, 0, 0, 0, 0),
    )  # fmt: skip


def shown(*spent: tuple[float, int]) -> list[int]:
    """Return the cost shown after each cycle of given time and cost."""
    worst_cycle, found = WorstCycle(), []
    for time_s, spent_us in spent:
        worst_cycle.add(cycle(spent_us), time_s)
        assert worst_cycle.cycle is not None
        found.append(sum(worst_cycle.cycle.stage_us))
    return found


def test_worst_cycle_of_a_second_is_shown() -> None:
    assert shown((0.0, 30), (0.2, 20), (0.4, 40), (0.6, 35)) == [30, 30, 40, 40]


def test_worst_cycle_stays_for_the_next_second() -> None:
    assert shown((0.0, 90), (1.0, 20), (1.5, 30), (2.0, 10), (2.5, 25), (3.0, 5)) == [
        90, 90, 90, 30, 30, 25,
    ]  # fmt: skip


def test_worst_cycle_is_dropped_after_a_silence() -> None:
    assert shown((0.0, 90), (5.0, 20)) == [90, 20]


def test_no_worst_cycle_before_the_first() -> None:
    assert WorstCycle().cycle is None


@dataclass
class Jittery(Robot):
    """A robot whose cycles cost between 15 and 24 us."""

    def cycle(self) -> CycleReport:
        return cycle(15 + self.tick % 10, self.tick)


@each("seconds", [2.0, 5.0])
def test_worst_cycle_of_a_standing_robot_is_stable(seconds: float) -> None:
    play = Play()
    play.robots = [Jittery()]
    play.forward(1.0)
    first = play.station.worst_cycle
    assert first is not None
    assert sum(first.stage_us) == 24
    for _ in range(round(seconds * 20)):
        play.forward(0.05)
        found = play.station.worst_cycle
        assert found is not None
        assert sum(found.stage_us) == 24


def test_restarted_robot_starts_with_its_own_cycles() -> None:
    play = Play()
    play.robots = [Jittery()]
    play.forward(2.0)
    play.robots = [Robot()]
    play.forward(0.05)
    found = play.station.worst_cycle
    assert found is not None
    assert sum(found.stage_us) == 15
