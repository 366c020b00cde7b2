"""Reactions by the gateway: guided goto beside the bus's own, and rest after a client falls silent.

A goto counts from the client's send to the first wheel command. The robot starts to drive at a tick
of its 50 ms grid. So each way sends at the same phases of the grid, spread evenly and in random
order, and both alternate. Silence counts from the last setpoint to wheels at rest, beyond its
time-out.
"""

import argparse
from collections.abc import Callable, Coroutine, Iterable, Mapping
from contextlib import suppress
from functools import partial
from itertools import cycle
from random import Random
from statistics import mean
from threading import Event
from time import monotonic, monotonic_ns
from typing import Any, Final, NamedTuple

from checks.harness.figures import Figure, figure, percentile
from checks.harness.mavlink_client import MavlinkClient
from checks.harness.observer import motion_since, stood_s
from checks.harness.operator import ThreadedOperator
from checks.harness.until import until
from checks.speed.gateway.stage import FORCED, Air, Figures, on_air, position_target
from gateways.mavlink.mavlink_dialect import REQUEST_OPERATOR_CONTROL, MavMessage, mavlink
from gateways.mavlink.motion.pilot import EnterGuided
from ground.client.goal import Destination
from ground.client.outcomes import Answer
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from protocol.wire.enums import Mode
from protocol.wire.messages import WheelCommand
from runtime.clock import WallClock
from runtime.units import PERIOD_NS, PERIOD_S

OVER_BUS_AT_MOST_MS: Final = 5.0
AGAIN_S: Final = 0.05
TRIES: Final = 40
BLOCKS: Final = 4
SETS_OFF_S: Final = 2.0
MAX_LOST: Final = 10
NEAR_M: Final = 0.2


class BusOperator(ThreadedOperator):
    """The typed client of the bus; it beats while it holds the lease."""

    def take(self) -> None:
        """Take the lease as soon as it is free, choose GUIDED and arm."""
        for call in (
            self.robot.lease.take,
            partial(self.robot.perform, EnterGuided()),
            self.robot.arm,
        ):
            self._repeat(call)

    def goto(self, x_m: float, y_m: float) -> int:
        """Send a goal; return the time before."""
        at_ns = monotonic_ns()
        goal = Destination(x_m=x_m, y_m=y_m, heading_rad=None)
        self._repeat(partial(self.send_goal, goal))
        return at_ns

    def release(self) -> None:
        """Stop, and give back the lease."""
        self._repeat(self.robot.hold)
        self._repeat(self.robot.lease.give_back)

    def _repeat(self, call: Callable[[], Coroutine[Any, Any, Answer]]) -> None:
        """Ask; again if the lease is not free yet, or the first heartbeat has not arrived."""
        for _ in range(TRIES):
            answer = self.wait(call())
            if answer.ok:
                return
            Event().wait(AGAIN_S)
        raise RuntimeError(answer.text)


class GatewayOperator:
    """The client of the gateway."""

    def __init__(self, client: MavlinkClient) -> None:
        self._client = client

    def take(self) -> None:
        """Take control by choosing GUIDED, once the robot is seen to hold, and arm."""
        newest = self._client.newest
        until(lambda: newest["HEARTBEAT"].custom_mode == Mode.HOLD, "mode HOLD in the heartbeat")
        self._client.set_mode(Mode.GUIDED)
        self._client.arm()

    def goto(self, x_m: float, y_m: float) -> int:
        """Send a position target; return the time before."""
        return self._client.send(position_target(x_m, y_m))

    def release(self) -> None:
        """Stop, and give back control."""
        self._client.set_mode(Mode.HOLD)
        self._client.command(REQUEST_OPERATOR_CONTROL, 0.0)


class Race:
    """Times both ways in turn."""

    def __init__(self, air: Air, operators: tuple[GatewayOperator, BusOperator]) -> None:
        self.lost: list[str] = []
        self._air = air
        self._operators = operators
        start, goal = air.observer.world.start, air.observer.world.goal
        self._places = cycle([(goal.x_m, goal.y_m), (start.x_m, start.y_m)])

    def drive_to_the_middle(self) -> None:
        """Drive to where both places are far away."""
        operator, world = self._operators[0], self._air.observer.world
        place = [(world.start.x_m + world.goal.x_m) / 2, (world.start.y_m + world.goal.y_m) / 2]
        operator.take()
        operator.goto(*place)
        until(lambda: abs(self._air.observer.truths[-1][0].x_m - place[0]) < NEAR_M, "the middle")
        operator.release()

    def block(self, goals: int, random: Random) -> tuple[list[float], list[float]]:
        """Return the times in ms by the gateway and by the bus."""
        phases = [(number + random.random()) / goals * PERIOD_NS for number in range(goals)]
        orders = [random.sample(phases, goals) for _ in self._operators]
        found: tuple[list[float], list[float]] = ([], [])
        for pair in zip(*orders, strict=True):
            place = next(self._places)
            for way in random.sample((0, 1), 2):
                took_ms = self._one(self._operators[way], pair[way], place)
                while took_ms is None:
                    took_ms = self._one(self._operators[way], pair[way], place)
                found[way].append(took_ms)
        return found

    def _one(
        self, operator: GatewayOperator | BusOperator, phase_ns: float, place: tuple[float, float]
    ) -> float | None:
        """Return the time in ms; None if the robot did not set off, as after a late tick."""
        wheels = self._air.observer.wheels
        operator.take()
        self._air.await_standing()
        until(lambda: is_zero(wheels[-1][0]), "no wheel command")
        newest_ns = wheels[-1][1]
        WallClock().sleep_until(newest_ns + 2 * PERIOD_NS + round(phase_ns))
        sent_ns = operator.goto(*place)
        with suppress(RuntimeError):
            until(lambda: first_ns(wheels, sent_ns) is not None, "a wheel command", SETS_OFF_S)
        first = first_ns(wheels, sent_ns)
        status = self._air.observer.status
        operator.release()
        if first is None:
            self.lost.append(f"{type(operator).__name__} {status}")
            if len(self.lost) > MAX_LOST:
                raise RuntimeError(f"the robot does not set off: {self.lost}")
            return None
        return (first - sent_ns) / 1e6


def is_zero(command: WheelCommand) -> bool:
    """Return whether a wheel command stops both wheels."""
    return command.left_mrad_s == 0 and command.right_mrad_s == 0


def first_ns(wheels: Iterable[tuple[WheelCommand, int]], after_ns: int) -> int | None:
    """Return when the first wheel command that turns a wheel has arrived, None if none has."""
    rows = tuple(wheels)
    return next((at_ns for one, at_ns in rows if at_ns > after_ns and not is_zero(one)), None)


def goto_figures(options: argparse.Namespace) -> Figures:
    """Measure both ways in turn, in blocks."""
    random = Random(1)
    goals = max(1, options.goals // BLOCKS)
    with on_air() as air, MavlinkClient(air.line()) as client:
        client.await_vehicle()
        network, robot = (
            Network(mode="client", connect=(air.observer.endpoint,)),
            air.observer.robot,
        )
        with (
            open_bus(network, Role.GROUND, robot) as bus,
            BusOperator(bus, robot) as bus_operator,
        ):
            race = Race(air, (GatewayOperator(client), bus_operator))
            race.drive_to_the_middle()
            race.block(2, random)
            blocks = [race.block(goals, random) for _ in range(BLOCKS)]
    return figures_of(blocks), [
        f"{BLOCKS} blocks of {goals} goals by each way, in turn; from before the send of"
        " SET_POSITION_TARGET_LOCAL_NED, or from before `Goto` of the typed client, to the arrival"
        " of the first wheel command that turns a wheel; both at the same phases of the robot's"
        " grid of 50 ms",
        *(f"not set off, repeated: {one}" for one in race.lost),
    ]


def figures_of(blocks: list[tuple[list[float], list[float]]]) -> list[Figure]:
    """Return the medians of each way in each block, and their differences."""
    found = []
    by_gateway, by_bus = ([one[way] for one in blocks] for way in (0, 1))
    for name, share in (("p50", 0.5), ("p90", 0.9)):
        ours = tuple(percentile(times, share) for times in by_gateway)
        bus = tuple(percentile(times, share) for times in by_bus)
        found += [
            figure(
                f"goto to wheel command, over the bus's own, {name}",
                [a - b for a, b in zip(ours, bus, strict=True)],
                "ms",
                at_most=OVER_BUS_AT_MOST_MS if share == 0.5 else None,
            ),
            figure(f"by the gateway, {name}", ours, "ms"),
            figure(f"by the bus, {name}", bus, "ms"),
        ]
    means = tuple(mean(a) - mean(b) for a, b in blocks)
    found.append(figure("over the bus's own, mean", means, "ms"))
    return found


AFTER_AT_MOST_MS: Final = 200.0
EVERY_S: Final = 0.1
DRIVES_S: Final = 1.2
FAST_M_S: Final = 0.1
VELOCITY_MASK: Final = 0b1101_1100_0111
"""A SET_POSITION_TARGET with a velocity only."""
ATTITUDE_MASK: Final = 0b0000_0011
FULL: Final = 1000
UNCHANGED: Final = 0xFFFF


class Setpoint(NamedTuple):
    """A way to drive: the mode, the time-out, and the message for a share of the full speed."""

    mode: Mode
    timeout_s: float
    message: Callable[[float], MavMessage]


def velocity(share: float) -> MavMessage:
    """Return a SET_POSITION_TARGET_LOCAL_NED along the robot's own axis."""
    frame = mavlink.MAV_FRAME_BODY_NED
    speed_m_s = 0.4 * share
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, VELOCITY_MASK, 0.0, 0.0, 0.0, speed_m_s, *(0.0,) * 7
    )


def attitude(share: float) -> MavMessage:
    """Return a SET_ATTITUDE_TARGET with a thrust and no turn."""
    level = [1.0, 0.0, 0.0, 0.0]
    return mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, ATTITUDE_MASK, level, 0.0, 0.0, 0.0, share
    )


def stick(share: float) -> MavMessage:
    """Return a MANUAL_CONTROL."""
    return mavlink.MAVLink_manual_control_message(1, 0, 0, round(FULL * share), 0, 0)


def channels(share: float) -> MavMessage:
    """Return an RC_CHANNELS_OVERRIDE."""
    drive = round(1500 + 500 * share)
    return mavlink.MAVLink_rc_channels_override_message(
        1, 1, 1500, UNCHANGED, drive, *(0xFFFF,) * 5
    )


SETPOINTS: Final[Mapping[str, Setpoint]] = {
    "SET_POSITION_TARGET": Setpoint(Mode.GUIDED, 1.0, velocity),
    "SET_ATTITUDE_TARGET": Setpoint(Mode.GUIDED, 1.0, attitude),
    "MANUAL_CONTROL": Setpoint(Mode.MANUAL, 0.5, stick),
    "RC_CHANNELS_OVERRIDE": Setpoint(Mode.MANUAL, 1.0, channels),
}


def timeout_figures(options: argparse.Namespace) -> Figures:
    """Let each kind of setpoint end several times, at random phases."""
    figures, random = [], Random(1)
    with on_air() as air, MavlinkClient(air.line()) as client:
        client.await_vehicle()
        client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, FORCED)
        for name, setpoint in SETPOINTS.items():
            times = tuple(
                after_ms(air, client, setpoint, random.random()) for _ in range(options.stops)
            )
            title = f"{name}: time-out to wheels at rest"
            figures += [
                figure(title, times, "ms"),
                figure(
                    f"{title}, worst of {len(times)}", max(times), "ms", at_most=AFTER_AT_MOST_MS
                ),
            ]
    return figures, [
        "time-outs: the plant's truth, first period without motion; negative: the wheels stood"
        " before the time-out, which is 1 s after the last message received, 0.5 s for"
        " MANUAL_CONTROL",
    ]


def after_ms(air: Air, client: MavlinkClient, setpoint: Setpoint, phase: float) -> float:
    """Drive, fall silent, and return the time in ms from the time-out to wheels at rest."""
    pause = Event()
    client.set_mode(setpoint.mode)
    heads_on = air.observer.truths[-1][0].x_m < 3.0
    share = 1.0 if heads_on else -1.0
    until_s, sent_ns = monotonic() + DRIVES_S + phase * PERIOD_S, 0
    while monotonic() < until_s:
        sent_ns = client.send(setpoint.message(share))
        pause.wait(EVERY_S)
    until(
        lambda: stood_s(motion_since(air.observer.truths, sent_ns)) is not None,
        "wheels at rest",
        10.0,
    )
    seen = motion_since(air.observer.truths, sent_ns)
    if abs(seen[0].truth.speed_m_s) < FAST_M_S:
        raise RuntimeError(f"the robot did not drive: {client.texts[-3:]}")
    stood = stood_s(seen)
    return ((stood or 0.0) - setpoint.timeout_s) * 1e3
