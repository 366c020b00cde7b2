"""Wheel commands at the plant: for how long they count, and which of two is the newer one."""

from typing import cast

import pytest

from plant.model.noise import LEVELS
from plant.process.robot_link import Wires
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.bus import Bus
from protocol.topics import DRIVE
from protocol.wire.messages import WheelCommand
from runtime.clock import ManualClock
from tests.support.played_bus import PlayedBus

PERIOD_S = 0.05
FAST = 9000


class Bench:
    """A plant at tick 20, and the wires that a test sends commands through."""

    def __init__(self) -> None:
        self._bus = PlayedBus(ManualClock())
        self.plant = Plant(load("open"), 0, LEVELS["none"])
        bus = cast(Bus, self._bus)
        self._wires = Wires(bus, "r1", 0, lambda _: None, lockstep=True)
        for _ in range(20):
            self._wires.publish(self.plant)
            self.plant.advance()

    def tick(self, *commands: tuple[int, int, int]) -> float:
        """A period in which these came: number, tick of their senses, speed. The speed after it."""
        self._wires.publish(self.plant)
        for seq, sense_seq, mrad_s in commands:
            self._bus.say(
                DRIVE,
                WheelCommand(
                    time_ns=0,
                    seq=seq,
                    sense_seq=sense_seq,
                    left_mrad_s=mrad_s,
                    right_mrad_s=mrad_s,
                    ttl_ms=150,
                ),
            )
        self._wires.obey(self.plant)
        self.plant.advance()
        return self.plant.truth().speed_m_s

    def ticks_driven(self, *commands: tuple[int, int, int]) -> int:
        """For how many periods the wheels are driven by what comes now, and nothing after it."""
        speeds = [self.tick(*commands)] + [self.tick() for _ in range(9)]
        fastest = max(speeds)
        return speeds.index(fastest) + 1 if fastest > 0.0 else 0


@pytest.mark.parametrize(("age", "driven"), [(0, 3), (1, 2), (2, 1), (3, 0), (20, 0)])
def test_a_command_counts_from_the_senses_that_it_answers(age: int, driven: int) -> None:
    assert Bench().ticks_driven((1, 20 - age, FAST)) == driven


def test_a_late_copy_does_not_make_it_count_for_longer() -> None:
    bench = Bench()
    command = (1, 20, FAST)
    speeds = [bench.tick(command), bench.tick(command), bench.tick(command)]
    assert speeds == sorted(speeds)
    assert bench.tick(command) < speeds[-1], "its 150 ms are over"


def test_one_that_was_overtaken_is_not_obeyed() -> None:
    bench = Bench()
    bench.tick((1, 20, FAST))
    bench.tick((3, 21, 0))
    slower_m_s = bench.tick()
    assert bench.tick((2, 21, FAST)) < slower_m_s


def test_a_robot_that_began_anew_is_obeyed() -> None:
    bench = Bench()
    bench.tick((4000, 20, 0))
    assert bench.tick((0, 21, FAST)) > 0.0
