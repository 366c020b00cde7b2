"""The plant process over real sockets: when time runs, when it pauses, and what it answers."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf

import pytest

from checks.harness.until import PATIENCE_S, until
from plant.model.configuration import noise_of
from plant.process import Process, Wake, assemble
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import CLOCK, DRIVE, RUN, SONAR, TRUTH, WHEELS, WORLD, Role
from protocol.wire.enums import AckResult, RunAction
from protocol.wire.messages import CommandAck, GroundTruth, RunRequest, RunScore, WheelCommand
from runtime.clock import Pulse, WallClock
from runtime.units import NS_PER_S as SECOND_NS
from runtime.units import PERIOD_NS


class Driver:
    """A robot of one idea: answers every tick with full speed ahead, until it is silent."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.silent = False
        self.tick = Pulse()
        self._wheels = bus.mailbox(WHEELS)
        self._drive = bus.publisher(DRIVE)
        bus.mailbox(SONAR)  # the plant waits until all its senses are listened to
        bus.mailbox(CLOCK, notify=self.tick.beat)
        self.truth = bus.mailbox(TRUTH)
        self.done = False

    def run(self, lockstep: bool) -> None:
        sequence = 0
        while not self.done:
            deadline_ns = WallClock().now_ns() + (SECOND_NS if lockstep else PERIOD_NS) // 5
            self.tick.wait_until(deadline_ns)
            newest = self._wheels.latest()
            if newest is None or self.silent:
                continue
            self._drive.put(
                WheelCommand(
                    time_ns=0,
                    seq=sequence,
                    sense_seq=newest[0].seq,
                    left_mrad_s=9000,
                    right_mrad_s=9000,
                    ttl_ms=150,
                )
            )
            sequence += 1

    def ask(self, action: int, until_ns: int = 0) -> object:
        return self.bus.ask(RUN, RunRequest(action=action, until_ns=until_ns), 2.0)

    def seen(self) -> GroundTruth:
        newest = self.truth.latest()
        assert newest is not None
        return newest[0]


@contextmanager
def running(
    lockstep: bool = True, paused: bool = False, speed: float = inf, patience_s: float = 0.05
) -> Iterator[Driver]:
    hub = Network(mode="peer", listen=("tcp/127.0.0.1:0",))
    with open_bus(hub, Role.ROBOT, "r1") as robot:
        network = Network(mode="client", connect=(robot.locator(),))
        with open_bus(network, Role.PLANT, "r1") as bus:
            world, wake = load("open"), Wake()
            plant = Plant(world, 0, noise_of(world, "none"))
            assembled = assemble(plant, bus, ["r1"], wake, lockstep=lockstep, paused=paused)
            process = Process(plant, assembled.links, assembled.requests, wake, patience_s)
            driver = Driver(robot)
            loops = [
                threading.Thread(target=process.run_lockstep, args=(speed,))
                if lockstep
                else threading.Thread(target=process.run_wall, args=(WallClock(),)),
                threading.Thread(target=driver.run, args=(lockstep,)),
            ]
            for loop in loops:
                loop.start()
            try:
                until(lambda: driver.truth.latest() is not None, what="the first truth")
                yield driver
            finally:
                driver.done = True
                wake.stop()
                for loop in loops:
                    loop.join(PATIENCE_S)
                    assert not loop.is_alive()


def drives(driver: Driver) -> bool:
    return driver.seen().speed_m_s > 0.25


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_paused_plant_shows_tick_0_until_it_is_started(lockstep: bool) -> None:
    with running(lockstep, paused=True) as driver:
        answer = driver.ask(RunAction.PAUSE)
        assert isinstance(answer, CommandAck)
        assert driver.seen().seq == 0
        driver.ask(RunAction.START)
        until(lambda: driver.seen().seq > 2, what="time went on")


def test_pause_stops_time_and_start_keeps_the_score() -> None:
    with running() as driver:
        until(lambda: driver.seen().seq > 40, what="the run")
        driver.ask(RunAction.PAUSE)
        before = driver.ask(RunAction.SCORE, 10**15)
        again = driver.ask(RunAction.SCORE, 10**15)
        assert isinstance(before, RunScore)
        assert before == again
        assert before.path_m > 0.1
        driver.ask(RunAction.START)
        until(lambda: driver.seen().time_ns > before.time_ns, what="time went on")
        after = driver.ask(RunAction.SCORE, before.time_ns)
        assert after == before


def test_a_start_of_a_running_plant_begins_a_new_score() -> None:
    with running() as driver:
        until(lambda: driver.seen().seq > 40, what="the run")
        driver.ask(RunAction.START)
        score = driver.ask(RunAction.SCORE, 0)
        assert isinstance(score, RunScore)
        assert score.ticks == 0
        assert score.time_ns > 0


def test_an_unknown_action_is_refused() -> None:
    with running() as driver:
        answer = driver.ask(99)
        assert isinstance(answer, CommandAck)
        assert answer.result == AckResult.UNSUPPORTED


def test_plant_returns_its_world_as_json() -> None:
    with running() as driver:
        told = driver.bus.ask(WORLD, None, PATIENCE_S)
        assert isinstance(told, bytes)
        assert json.loads(told)["name"] == "open"


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_wheels_stop_when_the_robot_falls_silent(lockstep: bool) -> None:
    with running(lockstep) as driver:
        until(lambda: drives(driver), what="the robot drives")
        driver.silent = True
        until(lambda: abs(driver.seen().speed_m_s) < 0.001, what="the wheels stand")


def test_a_robot_that_comes_back_is_obeyed_again() -> None:
    with running() as driver:
        until(lambda: drives(driver), what="the robot drives")
        driver.silent = True
        until(lambda: not drives(driver), what="the wheels stand")
        driver.silent = False
        until(lambda: drives(driver), what="the robot drives again")


def test_silent_robot_delays_the_world_only_once() -> None:
    with running(patience_s=1.0) as driver:
        until(lambda: drives(driver), what="the robot drives")
        driver.silent = True
        until(lambda: not drives(driver), what="the wheels stand")
        seq = driver.seen().seq
        until(lambda: driver.seen().seq >= seq + 40, within_s=30.0, what="two seconds")


def test_time_without_a_robot_is_not_faster_than_real_time() -> None:
    with running(speed=inf) as driver:
        driver.silent = True
        until(lambda: not drives(driver), what="the wheels stand")
        begun_ns, seq = WallClock().now_ns(), driver.seen().seq
        until(lambda: driver.seen().seq >= seq + 20, what="a second")
        # A frame that was taken late shortens this; without the limit it takes milliseconds.
        assert WallClock().now_ns() - begun_ns > 0.3 * SECOND_NS


def test_paused_plant_in_lockstep_shows_that_it_runs() -> None:
    with running(paused=True) as driver:
        until(lambda: driver.truth.latest() is not None, what="the first truth")
        arrived = [driver.truth.latest()]
        until(lambda: driver.truth.latest() is not arrived[0], what="another one")
        assert driver.seen().seq == 0


def test_speed_limits_the_rate_of_simulated_time() -> None:
    with running(speed=10.0) as driver:
        begun_ns, stamp_ns = WallClock().now_ns(), driver.seen().time_ns
        until(lambda: driver.seen().time_ns >= stamp_ns + 10 * SECOND_NS, what="ten seconds")
        assert WallClock().now_ns() - begun_ns >= 0.4 * SECOND_NS
