"""Latency from a published sensor sample to the wheel command, compared with a Zenoh ping-pong.

A substitute for plant and operator keeps a real robot process driving, paced by the wall clock at
the control rate. It publishes wheel ticks, scan and truth through the plant's own robot link, so a
measurement sees what a plant would see. The latency counts from before the first put to the arrival
of the command that answers them. Half a period later follows a ping with frames of the same sizes,
so that both run under the same load. Both are also shown back to back, where no process sleeps,
without a threshold. There, ours runs in lockstep, with the clock's frame and the telemetry of every
tick on the same link.

The ping-pong is the lower bound: two bare Zenoh processes without codec or loop. The child is the
hub that replies (`python -m checks.speed.latency PORT BYTES`), the parent the client that sends.
Both use direct callbacks and the flow settings of the stack.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from itertools import count, cycle
from threading import Event
from time import monotonic_ns
from typing import Any

import zenoh
from zenoh.handlers import Callback

from checks.harness.figures import BenchmarkReport, Figure, figure, percentile
from checks.harness.processes import (
    ROBOT,
    StartedRobot,
    ToldProcess,
    arm_request,
    auto_goal_request,
    await_subscribers,
    free_port,
    is_accepted,
    robot_process,
)
from plant.model.configuration import noise_of
from plant.robot_link import PlantLink
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.bus import Bus, open_bus
from protocol.outcome import wire_goal
from protocol.topics import COMMAND, STATUS, Role
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState
from protocol.wire.messages import CommandAck, CommandRequest, GoalRequest, SonarScan, WheelCommand
from protocol.wire.reasons import Reason
from protocol.world import World
from runtime.clock import WallClock, ticks
from runtime.errors import NoAnswerError
from runtime.units import CONTROL_HZ, PERIOD_NS
from study.trial.trial import wire_goal_of

PING, PONG = "floor/ping", "floor/pong"
PONG_WITHIN_S = 2.0
MOST_PINGS = 5
MATCH_WITHIN_S = 5.0


class PingPong:
    """Round trips of one payload size."""

    def __init__(self, session: zenoh.Session, size: int) -> None:
        self._payload = bytes(size)
        self._arrived_ns = 0
        self._arrived = Event()
        self._subscriber = session.declare_subscriber(PONG, Callback(self._receive, indirect=False))
        self._ping = flow(session, PING)
        await_matched(self._ping)

    def round_trip_ns(self) -> int | None:
        """Return the time from before the put to the reply; None without a reply."""
        self._arrived.clear()
        asked_ns = time.monotonic_ns()
        self._ping.put(self._payload)
        if not self._arrived.wait(PONG_WITHIN_S):
            return None
        return self._arrived_ns - asked_ns

    def _receive(self, _: zenoh.Sample) -> None:
        self._arrived_ns = time.monotonic_ns()
        self._arrived.set()


@contextmanager
def ping_pong(ping_bytes: int, pong_bytes: int) -> Iterator[PingPong]:
    """Start the replying process and yield the ping-pong."""
    port = free_port()
    with (
        ToldProcess("checks.speed.latency", str(port), str(pong_bytes)),
        zenoh.open(configured("client", connect=f"tcp/127.0.0.1:{port}")) as session,
    ):
        yield PingPong(session, ping_bytes)


def answer_pings(port: int, size: int) -> None:
    """Reply to pings until standard input is closed."""
    with zenoh.open(configured("peer", listen=f"tcp/127.0.0.1:{port}")) as session:
        pong, payload = flow(session, PONG), bytes(size)
        answering: Callback[zenoh.Sample] = Callback(lambda _: pong.put(payload), indirect=False)
        with session.declare_subscriber(PING, answering):
            print("listening", flush=True)
            sys.stdin.read()


def flow(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """Declare a publisher with the flow settings of the stack."""
    return session.declare_publisher(
        key,
        priority=zenoh.Priority.REAL_TIME,
        congestion_control=zenoh.CongestionControl.DROP,
        express=False,
    )


def await_matched(publisher: zenoh.Publisher) -> None:
    """Wait until a subscriber is found; raise RuntimeError otherwise."""
    matched = Event()
    noticing: Callback[zenoh.MatchingStatus] = Callback(
        lambda status: matched.set() if status.matching else None, indirect=False
    )
    with publisher.declare_matching_listener(noticing):
        status: Any = publisher.matching_status  # always truthy, unlike its stub
        if not (status.matching or matched.wait(MATCH_WITHIN_S)):
            raise RuntimeError("the two processes of the ping-pong did not connect")


def configured(mode: str, listen: str | None = None, connect: str | None = None) -> zenoh.Config:
    """Return the configuration of a session."""
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def paced(count: int) -> Iterator[int]:
    """Yield the monotonic time in ns at which each of `count` ticks was due."""
    for tick, _ in zip(ticks(WallClock(), CONTROL_HZ), range(count), strict=False):
        yield tick.due_ns


def wait_until(deadline_ns: int) -> None:
    """Sleep until a monotonic time."""
    WallClock().sleep_until(deadline_ns)


ANSWER_WITHIN_S = 0.04
READY_WITHIN_S = 10.0
STANDS_AFTER = 4
TOO_BUSY = (Reason.BUDGET, Reason.NOT_ARMED, Reason.NO_SENSES)
"""Why a robot whose loop is too slow, or this program, refuses to be armed, or to drive."""
SETS_OFF_WITHIN = 100


class PlantStandIn:
    """A plant with one robot that a measurement advances; `operator` is the bus for goals."""

    def __init__(self, bus: Bus, operator: Bus, world: World, *, lockstep: bool) -> None:
        self.plant = Plant(world, 0, noise_of(world))
        self.bus = bus
        self._operator = operator
        self._arrived = Event()
        self._arrived_ns = 0
        self._link = PlantLink(bus, ROBOT, 0, self._notice, lockstep=lockstep)
        self._status = bus.mailbox(STATUS, ROBOT)
        back = wire_goal(world.start.x_m, world.start.y_m, None, 0.1, 0.1)
        self._goals = cycle((wire_goal_of(world), back))
        self._requests = count(monotonic_ns())
        self._ticks_without_goal = 0
        self._departure: Future[None] | None = None
        self._pool = ThreadPoolExecutor(1)
        await_subscribers(bus, self._link.publishers, READY_WITHIN_S)

    def tick(self, patience_s: float = ANSWER_WITHIN_S) -> int | None:
        """Publish the senses, take the wheel command and advance one period.

        Return the nanoseconds from before the first put to the arrival of the command that answers
        these senses; None when none arrived in time.
        """
        frames = self._link.frames(self.plant)
        self._arrived.clear()
        published_ns = monotonic_ns()
        for publisher, frame in frames:
            publisher.put_frame(frame)
        self._link.publish_clock_and_truth(self.plant)
        while answered := self._arrived.wait(patience_s):
            if self._link.answered:
                break
            self._arrived.clear()
        took_ns = self._arrived_ns - published_ns
        self._link.apply_command(self.plant)
        self.plant.advance()
        self._keep_driving()
        return took_ns if answered else None

    @property
    def drives(self) -> bool:
        """True if the robot has a goal that has not ended."""
        newest = self._status.latest()
        return newest is not None and GoalState.ACCEPTED <= newest[0].goal <= GoalState.ALIGNING

    def close(self) -> None:
        """Cancel requests that have not been sent."""
        self._pool.shutdown(cancel_futures=True)

    def _keep_driving(self) -> None:
        """Set off again when the goal has ended, in a thread: an answer takes ticks."""
        if self._departure is not None:
            if not self._departure.done():
                return
            self._departure.result()
            self._departure, self._ticks_without_goal = None, 0
        self._ticks_without_goal = 0 if self.drives else self._ticks_without_goal + 1
        if self._ticks_without_goal >= STANDS_AFTER:
            self._departure = self._pool.submit(self._set_off)

    def _set_off(self) -> None:
        """Arm, and drive to the goal and back to the start in turn; or wait for a better moment."""
        if self._obeys(arm_request(next(self._requests))):
            self._obeys(auto_goal_request(next(self._requests), next(self._goals)))

    def _obeys(self, request: CommandRequest | GoalRequest) -> bool:
        """Ask for something; return False if the robot's own loop is too slow at the moment.

        It may also have been too slow since it was armed, and have disarmed itself; or a busy
        machine has dropped the request or its answer.

        Raises:
            RuntimeError: It refuses for another reason, which waiting does not change.
        """
        try:
            answer = self._operator.ask(COMMAND, request, robot=ROBOT)
        except NoAnswerError:
            return False
        if is_accepted(answer):
            return True
        if isinstance(answer, CommandAck) and answer.result_param2 in TOO_BUSY:
            return False
        raise RuntimeError(f"the robot refused {request}: {answer!r}")

    def _notice(self, arrived_ns: int) -> None:
        self._arrived_ns = arrived_ns
        self._arrived.set()


@contextmanager
def driving(world: World, robot: StartedRobot, *, lockstep: bool) -> Iterator[PlantStandIn]:
    """Run a plant and keep its robot driving."""
    with (
        open_bus(robot.network, Role.PLANT, ROBOT) as bus,
        open_bus(robot.network, Role.GROUND, ROBOT) as operator,
    ):
        standin = PlantStandIn(bus, operator, world, lockstep=lockstep)
        with closing(standin):
            for _ in paced(SETS_OFF_WITHIN):
                standin.tick(patience_s=1.0 if lockstep else ANSWER_WITHIN_S)
                if standin.drives:
                    break
            yield standin


P50_AT_MOST, P99_AT_MOST = 2.0, 3.0
WARM_UP = 40
BUSY = 2000


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--blocks", type=int, default=6)
    parser.add_argument("--ticks", type=int, default=200, help="in each block")
    parser.add_argument("--realtime", action="store_true", help="run the robot with SCHED_FIFO")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Measure latency and ping-pong in turn, and both back to back."""
    world = load(options.world)
    flags = ["--realtime"] if options.realtime else []
    with (
        robot_process(world, *flags) as robot,
        ping_pong(*sizes()) as pings,
        driving(world, robot, lockstep=False) as standin,
    ):
        in_turn(standin, pings, WARM_UP)
        blocks = [in_turn(standin, pings, options.ticks) for _ in range(options.blocks)]
        busy_us = [trip_us(pings) for _ in range(BUSY)]
        lockstep_us = in_lockstep(world, BUSY)
    figures = [
        *figures_of("p50", 0.5, blocks, P50_AT_MOST),
        *figures_of("p99", 0.99, blocks, P99_AT_MOST),
    ]
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        bare_us, ours_us = percentile(busy_us, share), percentile(lockstep_us, share)
        figures += [
            figure(f"ours / floor back to back, {name}", ours_us / bare_us, "x"),
            figure(f"sense to command back to back, {name}", ours_us, "us"),
            figure(f"floor back to back, {name}", bare_us, "us"),
        ]
    lost = sum(options.ticks - len(ours) for ours, _ in blocks)
    notes = (
        f"{options.blocks} blocks of {options.ticks} ticks at 20 Hz; {lost} commands not in time",
        "ours includes samples, decoding, core and encoding; the floor only passes bytes",
        *(line for line in robot.output if "warning" in line),
    )
    return BenchmarkReport(benchmark="latency", figures=tuple(figures), notes=notes)


def in_lockstep(world: World, ticks: int) -> list[float]:
    """Return the times in us from samples to command in lockstep."""
    with (
        robot_process(world, "--lockstep") as robot,
        driving(world, robot, lockstep=True) as standin,
    ):
        return [took_ns / 1e3 for _ in range(ticks) if (took_ns := standin.tick()) is not None]


def in_turn(standin: PlantStandIn, pings: PingPong, ticks: int) -> tuple[list[float], list[float]]:
    """Return the times in us of ours and of the ping-pong, half a period apart."""
    ours: list[float] = []
    floors: list[float] = []
    for due_ns in paced(ticks):
        took_ns = standin.tick()
        if took_ns is not None:
            ours.append(took_ns / 1e3)
        wait_until(due_ns + PERIOD_NS // 2)
        floors.append(trip_us(pings))
    return ours, floors


def trip_us(pings: PingPong) -> float:
    """Return one round trip of the ping-pong in us.

    Messages that a busy machine congests are dropped, as in the stack, so a ping without a reply is
    sent again; raises RuntimeError after several.
    """
    for _ in range(MOST_PINGS):
        if (took_ns := pings.round_trip_ns()) is not None:
            return took_ns / 1e3
    raise RuntimeError(f"no reply to {MOST_PINGS} pings")


def figures_of(
    name: str, share: float, blocks: list[tuple[list[float], list[float]]], at_most: float
) -> list[Figure]:
    """Return the figures of one quantile."""
    ours = tuple(percentile(block[0], share) for block in blocks)
    floors = tuple(percentile(block[1], share) for block in blocks)
    ratios = tuple(a / b for a, b in zip(ours, floors, strict=True))
    return [
        figure(f"ours / floor, {name}", ratios, "x", at_most=at_most),
        figure(f"sense to command, {name}", ours, "us"),
        figure(f"floor at 20 Hz, {name}", floors, "us"),
    ]


def sizes() -> tuple[int, int]:
    """Return the sizes of a scan and of a wheel command on the wire in bytes."""
    encoder = Encoder(1, 1)
    stamp_ns = 123_450_000_000
    scan = SonarScan(
        time_ns=stamp_ns,
        seq=2469,
        range_mm=(412,) * 8,
        ping_age_us=(25_000, 0) * 4,
        valid=255,
        echo=255,
    )
    command = WheelCommand(
        time_ns=stamp_ns,
        seq=2468,
        sense_seq=2469,
        left_mrad_s=8123,
        right_mrad_s=7544,
        ttl_ms=150,
    )
    return len(encoder.encode(scan)), len(encoder.encode(command))


if __name__ == "__main__":
    answer_pings(int(sys.argv[1]), int(sys.argv[2]))
