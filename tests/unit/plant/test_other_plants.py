"""What plants of one world tell each other: motions, orders, and that one has gone."""

from typing import Final

import pytest

from plant.other_plants import OtherPlants
from plant.sim.simulation import Plant
from protocol.topics import MOTION, Role
from protocol.wire.message import Message
from runtime.clock import ManualClock
from tests.support.plant import FOREVER_NS, NONE, room
from tests.support.played_bus import PlayedBus

NAMES: Final = ("r1", "r2")
WORLD: Final = room(start=(2.0, 1.5, 0.0))


class OnePlant:
    """One of two plants, each with a robot; what it publishes is delivered when a test says so."""

    def __init__(self, number: int, world: bytes = b"same", *, lockstep: bool = True) -> None:
        self.number = number
        self.bus = PlayedBus(ManualClock())
        self.plant = Plant(WORLD, 1, NONE, robots=2, own=[number])
        self.nudges = 0
        away = 1 - number
        self.others = OtherPlants(
            self.bus,
            {number: NAMES[number]},
            {away: NAMES[away]},
            world,
            self._nudge,
            lockstep=lockstep,
        )
        self.bus.watch(self.others.note_presence)

    def _nudge(self) -> None:
        self.nudges += 1

    def sent(self) -> list[Message]:
        """Return what it has published since the last call."""
        sent, self.bus.sent[:] = [message for _, message in self.bus.sent], []
        return sent

    def receive(self, messages: list[Message]) -> None:
        for message in messages:
            self.bus.say(MOTION, message, NAMES[1 - self.number])

    def step(self) -> None:
        self.plant.advance(self.others.motions())


@pytest.fixture
def pair() -> tuple[OnePlant, OnePlant]:
    return OnePlant(0), OnePlant(1)


def exchange(pair: tuple[OnePlant, OnePlant]) -> None:
    left, right = pair
    left.others.tell(left.plant)
    right.others.tell(right.plant)
    left.receive(right.sent())
    right.receive(left.sent())


def test_motion_arrives_to_the_last_bit(pair: tuple[OnePlant, OnePlant]) -> None:
    left, right = pair
    whole = Plant(WORLD, 1, NONE, robots=2)
    for plant, number in ((whole, 0), (whole, 1), (left.plant, 0), (right.plant, 1)):
        plant.command(number, 7000 - number, 6500, FOREVER_NS)
    for _ in range(40):
        exchange(pair)
        left.step()
        right.step()
        whole.advance()
    assert left.plant.score(FOREVER_NS, 0) == whole.score(FOREVER_NS, 0)
    assert right.plant.senses(1) == whole.senses(1)


def test_tick_waits_for_the_motion_of_each_other_robot(pair: tuple[OnePlant, OnePlant]) -> None:
    left, right = pair
    left.others.tell(left.plant)
    assert left.others.silent
    right.others.tell(right.plant)
    left.receive(right.sent())
    assert not left.others.silent
    assert left.nudges == 1


def test_plant_that_is_a_tick_ahead_is_not_missed(pair: tuple[OnePlant, OnePlant]) -> None:
    """Keep both motions: one of the next tick must not replace that of this one."""
    left, right = pair
    exchange(pair)
    right.step()
    right.others.tell(right.plant)
    left.receive(right.sent())
    left.step()
    left.others.tell(left.plant)
    assert not left.others.silent
    left.step()
    assert left.plant.now_ns == right.plant.now_ns + right.plant.now_ns


def test_lost_motion_is_sent_again_also_that_of_the_tick_before(
    pair: tuple[OnePlant, OnePlant],
) -> None:
    left, right = pair
    left.others.tell(left.plant)
    right.others.tell(right.plant)
    right.receive(left.sent())
    right.step()
    right.others.tell(right.plant)
    right.sent()  # all lost
    right.others.repeat()
    left.receive(right.sent())
    assert not left.others.silent
    left.step()
    left.others.tell(left.plant)
    assert not left.others.silent


def test_old_motion_changes_nothing_in_lockstep(pair: tuple[OnePlant, OnePlant]) -> None:
    left, right = pair
    right.others.tell(right.plant)
    old = right.sent()
    left.receive(old)
    left.others.tell(left.plant)
    right.receive(left.sent())
    for one in pair:
        one.step()
        one.others.tell(one.plant)
    left.receive(right.sent())
    left.receive(old)
    assert not left.others.silent


def test_wall_time_takes_the_newest_motion_and_waits_for_none() -> None:
    left, right = OnePlant(0, lockstep=False), OnePlant(1, lockstep=False)
    left.others.tell(left.plant)
    assert not left.others.silent
    assert left.others.motions() == {}
    for _ in range(3):
        right.others.tell(right.plant)
        left.receive(right.sent())
        told = right.plant.motions()
        right.step()
    assert left.others.motions() == told


def test_start_and_pause_act_on_all_plants(pair: tuple[OnePlant, OnePlant]) -> None:
    left, right = pair
    exchange(pair)
    assert right.others.take_order(running=True) == (True, False)
    left.others.order(running=False)
    right.receive(left.sent())
    assert right.others.take_order(running=True) == (False, False)
    assert right.others.take_order(running=False) == (False, False)
    right.others.order(running=True)
    left.receive(right.sent())
    assert left.others.take_order(running=False) == (True, False)


def test_start_of_running_plants_begins_a_new_score_of_each(
    pair: tuple[OnePlant, OnePlant],
) -> None:
    left, right = pair
    exchange(pair)
    left.others.order(running=True)
    assert left.others.take_order(running=True) == (True, False)
    right.receive(left.sent())
    assert right.others.take_order(running=True) == (True, True)


def test_start_that_overtakes_its_pause_begins_no_new_score(
    pair: tuple[OnePlant, OnePlant],
) -> None:
    left, right = pair
    exchange(pair)
    left.others.order(running=False)
    left.sent()  # lost
    left.others.order(running=True)
    right.receive(left.sent())
    assert right.others.take_order(running=True) == (True, False)


def test_plant_ends_when_another_one_has_gone(pair: tuple[OnePlant, OnePlant]) -> None:
    left, _ = pair
    left.bus.come(Role.PLANT, "r2")
    left.bus.come(Role.ROBOT, "r2")
    left.bus.go(Role.ROBOT, "r2")
    assert left.others.why_ended == ""
    left.bus.go(Role.PLANT, "r2")
    assert left.others.why_ended.startswith("the plant of r2 has gone: start all plants")
    assert left.nudges


def test_plant_of_another_world_is_refused_by_name() -> None:
    left, right = OnePlant(0), OnePlant(1, b"another")
    right.others.tell(right.plant)
    left.receive(right.sent())
    assert "the plant of r2 simulates another world: give all plants" in left.others.why_ended
    left.others.tell(left.plant)
    assert left.others.silent
