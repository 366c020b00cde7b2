"""Measure what a robot keeps when it is killed or loses its power, and how long a recovery takes.

Recovery: the time counts from the signal until `up` has restarted a process and all are received
again. It includes the start of a Python process, and for a hub the next connection attempt of its
clients.

Power cuts: a parameter and the fence are changed in turn, and acknowledged changes survive a cut.
The number of the repetition draws the disk operation after which the power is cut. A robot is
started from each state that a file system which reorders writes may leave then.

An emergency stop outlives the process: the robot is killed, or frozen until `up` ends it, as soon
as it has reported that the stop is on the disk, or the power is cut on a disk in memory. The robot
that is started then must be stopped, and must refuse to arm.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple
from unittest.mock import patch

from checks.faults.cases import Repetition
from checks.harness.figures import BenchmarkReport, Figure, figure
from checks.harness.operator import ThreadedOperator
from checks.harness.reordering_disk import ReorderingDisk, State
from ground.cli.main import parse
from ground.cli.run.up import connect, free_endpoint
from ground.client.outcomes import Refused
from ground.launch.launcher import Stack
from ground.launch.scenario import WALL, run_of, scenario_of
from ground.launch.supervisor import RestartPolicy
from ground.missions.mission import Circle
from ground.missions.transfer import fence_items_of
from protocol.bus.bus import Bus
from protocol.bus.session import listens
from protocol.topics import STATUS, TEXT, TRUTH
from protocol.wire.codec import decode
from protocol.wire.enums import Command, MissionType, Vehicle
from protocol.wire.messages import (
    CommandRequest,
    MissionCount,
    MissionVerdict,
    NavigatorStatus,
    ParamSet,
    ParamValue,
)
from protocol.wire.reasons import Reason
from protocol.wire.statustext import StatustextAssembler
from robot.core.parameters import DEFAULTS
from robot.emergency_stop import SAVED, emergency_stop
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime import files
from runtime.clock import WallClock
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_S


@contextmanager
def restarted(state: State, folder: Path) -> Iterator[None]:
    """Write the files of a state below a real directory, which the code under test uses inside."""
    for path, content in state:
        file = folder / path.removeprefix("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    with patch.object(files, "os", os):
        yield


HOME: Final = Path("/state/of/r1")
CHANGES: Final = 6
TUNED: Final = "d_obs_m"


class SavedState(NamedTuple):
    """The operator's settings: a parameter, and the radius of the fence, 0 for none."""

    value: float = DEFAULTS.d_obs_m
    radius_m: float = 0.0


def run(fault: str, way: str, number: int, disk: ReorderingDisk | None = None) -> Repetition:
    """Cut the power once; the repetition has `reached` when all acknowledged changes are there."""
    disk, random = disk or ReorderingDisk(), Random(f"{fault} {number}")
    with patch.object(files, "os", disk), TemporaryDirectory() as folder:
        changes = make_changes(RobotVehicle(DEFAULTS, Store(HOME)), disk, random)
        cut = random.randrange(len(disk.cuts))
        answered, before = [one for one in changes if one[0] <= cut + 1][-1]
        under_way = next((state for operations, state in changes if operations > cut + 1), before)
        allowed = {before} if answered == cut + 1 else {before, under_way}
        found = {
            found_in(state, Path(folder) / str(index)) for index, state in enumerate(disk.cuts[cut])
        }
    lost = found - allowed
    words = f"after operation {cut}: {min(lost)} instead of {before}" if lost else ""
    return Repetition(fault=fault, way=way, number=number, reached=not lost, trouble=words)


def make_changes(
    vehicle: RobotVehicle, disk: ReorderingDisk, random: Random
) -> list[tuple[int, SavedState]]:
    """Make changes; return each state with the number of disk operations until its answer."""
    state = SavedState()
    changes = [(1, state)]
    for change in range(CHANGES):
        drawn = round(random.uniform(0.3, 0.5), 3) if change % 2 else random.randint(2, 9) * 1.0
        state = state._replace(value=drawn) if change % 2 else state._replace(radius_m=drawn)
        set_value(vehicle, drawn) if change % 2 else upload_fence(vehicle, drawn)
        changes.append((len(disk.cuts), state))

    return changes


def set_value(vehicle: RobotVehicle, value: float) -> None:
    """Set the parameter."""
    answer = vehicle.receive(ParamSet(param_id=TUNED, param_value=value, param_type=9), 0)
    if not isinstance(answer, ParamValue):
        raise RuntimeError(f"the robot did not set {TUNED}: {answer}")


def upload_fence(vehicle: RobotVehicle, radius_m: float) -> None:
    """Upload a round fence."""
    (fence,) = fence_items_of(Circle(x_m=0.0, y_m=0.0, radius_m=radius_m))
    vehicle.receive(MissionCount(count=1, mission_type=MissionType.FENCE), 0)
    answer = vehicle.receive(fence, 0)
    if not isinstance(answer, MissionVerdict) or answer.reason != Reason.NONE:
        raise RuntimeError(f"the robot did not accept the fence: {answer}")


def found_in(state: State, folder: Path) -> SavedState:
    """Return the state of a robot that is started after this cut."""
    with restarted(state, folder):
        store = Store(folder / str(HOME).removeprefix("/"))
        params, _ = store.load(DEFAULTS)
        vehicle = RobotVehicle(params, store)
        vehicle.restore()
    fence = vehicle.state.machine.fence
    return SavedState(params.d_obs_m, 0.0 if fence is None else fence.radius_m)


ECHO_NS: Final = 100 * NS_PER_MS
"""Samples that arrive this soon after a kill were sent before it."""
LOOK_NS: Final = 2 * NS_PER_MS
PATIENCE_NS: Final = 15_000 * NS_PER_MS
HANG_NS: Final = 60 * NS_PER_S
SETTLED_NS: Final = 700 * NS_PER_MS
ROUTER_S: Final = 1.0
SAVED_MS: Final = 1000.0
RESTARTED: Final = "restarted: the previous run"
NO_PAUSE: Final = RestartPolicy(pause_ns=0, limit=1_000_000)
ROLES: Final = (("robot r1", False), ("plant", False), ("robot r1", True), ("router", True))


class Recovery(NamedTuple):
    """Seconds from the kill until the hub listens, and until robot and plant are received."""

    listens_s: float
    received_s: float


class ArrivalTimes:
    """The newest arrival times of samples of robot and plant."""

    def __init__(self, bus: Bus) -> None:
        self._arrived_ns = {STATUS.path: 0, TRUTH.path: 0}
        for topic in (STATUS, TRUTH):
            bus.stream(topic, partial(self._record, topic.path))

    def _record(self, path: str, _key: str, _frame: bytes, at_ns: int) -> None:
        self._arrived_ns[path] = at_ns

    def both_since(self, since_ns: int) -> bool:
        """Return whether both were received after that time."""
        return min(self._arrived_ns.values()) > since_ns


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench restarts`."""
    parser.add_argument("--repetitions", type=int, default=20)
    help = "repetitions of each way to end a robot in its emergency stop (default 3)"
    parser.add_argument("--stops", type=int, default=3, help=help)


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Kill each process repeatedly, and report the recovery times."""
    figures: list[Figure] = []
    for role, router in ROLES:
        with running(router=router) as (stack, arrivals, clock):
            took = [recovered(stack, arrivals, clock, role) for _ in range(options.repetitions)]
        name = role.partition(" ")[0] + (" behind a router" if router and role != "router" else "")
        figures += of(name, took, ROUTER_S if role == "router" else None)
    figures += kept_stops(options.stops)
    return BenchmarkReport(
        benchmark="restarts",
        figures=tuple(figures),
        notes=("SIGKILL; publishing: the robot's status and the plant's truth, from outside",),
    )


def of(name: str, took: list[Recovery], most_s: float | None) -> list[Figure]:
    """Return the figures of a process; `most_s` limits the time after its restart."""
    received = tuple(one.received_s for one in took)
    found = [figure(f"{name}, kill to all publishing", received, "s")]
    if most_s is not None:
        healing = tuple(one.received_s - one.listens_s for one in took)
        found.append(figure(f"{name}, listening to all publishing", healing, "s", at_most=most_s))
    return found


@contextmanager
def running(
    *, router: bool, policy: RestartPolicy = NO_PAUSE, clock_name: str = WALL
) -> Iterator[tuple[Stack, ArrivalTimes, WallClock]]:
    """Run robot and plant at rest, supervised as by `up` but without a restart limit."""
    clock = WallClock()
    words = ["up", "--clock", clock_name, "--world", "open", *(["--router"] if router else [])]
    options = parse(words)
    scenario = scenario_of(options, run_of(options))
    with Stack(options, scenario, free_endpoint(), clock, policy) as stack:
        stack.start()
        with connect(stack.common, clock, stack.check) as bus:
            arrivals = ArrivalTimes(bus)
            await_both(stack, arrivals, clock, clock.now_ns())
            stack.supervise(bus)
            yield stack, arrivals, clock


def recovered(stack: Stack, arrivals: ArrivalTimes, clock: WallClock, role: str) -> Recovery:
    """Kill a process and return its recovery."""
    settled_ns = clock.now_ns() + SETTLED_NS
    while clock.now_ns() < settled_ns:
        stack.check()
        clock.sleep_until(clock.now_ns() + LOOK_NS)
    killed_ns = clock.now_ns()
    stack.inject_fault(role, "end")
    if role == "router":
        for there in (False, True):
            while listens(stack.common.endpoint) is not there:
                stack.check()
                clock.sleep_until(clock.now_ns() + LOOK_NS)
    listens_ns = clock.now_ns()
    received_ns = await_both(stack, arrivals, clock, killed_ns + ECHO_NS)
    return Recovery((listens_ns - killed_ns) / NS_PER_S, (received_ns - killed_ns) / NS_PER_S)


def await_both(
    stack: Stack,
    arrivals: ArrivalTimes,
    clock: WallClock,
    since_ns: int,
    patience_ns: int = PATIENCE_NS,
) -> int:
    """Wait until both were received after a time, and return that time."""
    while not arrivals.both_since(since_ns):
        stack.check()
        if clock.now_ns() - since_ns > patience_ns:
            raise RemoteError(f"robot or plant not received within {patience_ns / NS_PER_S:g} s")
        clock.sleep_until(clock.now_ns() + LOOK_NS)
    return clock.now_ns()


def kept_stops(repetitions: int) -> list[Figure]:
    """Return how many stops outlived kills, hangs and power cuts, and how long saving them took."""
    held: dict[str, int] = {}
    saved_ms: list[float] = []
    with (
        running(router=False) as (stack, arrivals, clock),
        connect(stack.common, clock, stack.check) as bus,
        ThreadedOperator(bus, stack.common.robot) as operator,
    ):
        witness = StopWitness(stack, operator, arrivals, clock)
        for what, fault in (("kills", "end"), ("hangs", "hang")):
            held[what] = 0
            for _ in range(repetitions):
                saved_ms.append(witness.stop() / NS_PER_MS)
                held[what] += witness.held_after(fault)
                witness.release()
    held["power cuts"] = sum(map(held_after_cut, range(repetitions)))
    figures = [
        figure(
            f"emergency stops that outlive {what}",
            count,
            f"of {repetitions}",
            at_least=float(repetitions),
        )
        for what, count in held.items()
    ]
    told = figure("press to the report that the stop is saved", saved_ms, "ms")
    slowest = figure("the slowest of them", max(saved_ms), "ms", at_most=SAVED_MS)
    return [*figures, told, slowest]


class StopWitness:
    """An operator who stops the robot and sees what becomes of it."""

    def __init__(
        self, stack: Stack, operator: ThreadedOperator, arrivals: ArrivalTimes, clock: WallClock
    ) -> None:
        self._stack, self._arrivals, self._clock = stack, arrivals, clock
        self._operator, self._robot = operator, operator.robot
        self._texts: list[str] = []
        self._status: NavigatorStatus | None = None
        assembler = StatustextAssembler()

        def take(_key: str, frame: bytes, _at_ns: int) -> None:
            message = decode(frame).message
            if isinstance(message, NavigatorStatus):
                self._status = message
            elif words := assembler.receive(message):
                self._texts.append(words)

        for topic in (STATUS, TEXT):
            operator.robot.bus.stream(topic, take)

    def stop(self) -> int:
        """Stop the robot; return the time in ns until it has reported that the stop is saved."""
        self._texts.clear()
        pressed_ns = self._clock.now_ns()
        if not self._operator.wait(self._robot.emergency_stop()).ok:
            raise RemoteError("the robot did not acknowledge its emergency stop")
        self._await(lambda: SAVED in self._texts, SAVED)
        return self._clock.now_ns() - pressed_ns

    def held_after(self, fault: str) -> bool:
        """End the robot in this way; return whether the next one is stopped and stays so."""
        self._texts.clear()
        hurt_ns = self._clock.now_ns()
        self._stack.inject_fault("robot r1", fault)
        self._await(lambda: any(RESTARTED in words for words in self._texts), RESTARTED)
        await_both(self._stack, self._arrivals, self._clock, hurt_ns + ECHO_NS, HANG_NS)
        refused = self._operator.wait(self._robot.arm())
        reason = refused.reason if isinstance(refused, Refused) else Reason.NONE
        status = self._status
        is_stopped = status is not None and status.vehicle == Vehicle.EMERGENCY_STOP
        return is_stopped and reason == Reason.EMERGENCY_STOPPED

    def release(self) -> None:
        """Release the stop."""
        if not self._operator.wait(self._robot.clear_emergency_stop()).ok:
            raise RemoteError("the robot did not release its emergency stop")

    def _await(self, condition: Callable[[], object], what: str) -> None:
        deadline_ns = self._clock.now_ns() + HANG_NS
        while not condition():
            self._stack.check()
            while self._stack.next_event():
                pass
            if self._clock.now_ns() > deadline_ns:
                raise RemoteError(f"not within {HANG_NS / NS_PER_S:g} s: {what}")
            self._clock.sleep_until(self._clock.now_ns() + LOOK_NS)


def held_after_cut(number: int) -> bool:
    """Cut the power after a stop, while other state is saved; return whether each state keeps it.

    The number draws what is saved before and after the stop, and the disk operation of the cut.
    """
    random, disk = Random(f"stop {number}"), ReorderingDisk()
    with patch.object(files, "os", disk), TemporaryDirectory() as folder:
        vehicle = RobotVehicle(DEFAULTS, Store(HOME))
        for request_id in range(random.randrange(3)):
            vehicle.receive(emergency_stop(request_id), 0)
            vehicle.receive(clearing(request_id), 0)
            set_value(vehicle, round(random.uniform(0.3, 0.5), 3))
        vehicle.receive(emergency_stop(7), 0)
        saved = len(disk.cuts)
        for _ in range(random.randrange(4)):
            change = random.choice((set_value, upload_fence))
            change(vehicle, round(random.uniform(0.3, 0.5), 3))
        states = disk.cuts[random.randrange(saved - 1, len(disk.cuts))]
        return all(
            is_stopped_after(state, Path(folder) / str(index)) for index, state in enumerate(states)
        )


def clearing(request_id: int) -> CommandRequest:
    """Return the request that releases a stop."""
    command = Command.SIDESTEP_CLEAR_EMERGENCY_STOP
    return CommandRequest(request_id=100 + request_id, command=command, param1=0.0, param2=0.0)


def is_stopped_after(state: State, folder: Path) -> bool:
    """Return whether a robot that is started after a power cut is stopped."""
    with restarted(state, folder):
        vehicle = RobotVehicle(DEFAULTS, Store(folder / str(HOME).removeprefix("/")))
        vehicle.restore()
    return vehicle.stopped
