"""Measure the recovery from a kill: until `up` has restarted a process and all are received again.

The time counts from the signal. It includes the start of a Python process, and for a hub the next
connection attempt of its clients.
"""

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Final, NamedTuple

from ground.cli.main import parse
from ground.cli.run.up import connect, free_endpoint
from ground.launch.child_command import command
from ground.launch.launcher import Stack
from ground.launch.restart_policy import RestartPolicy
from ground.launch.scenario import WALL, scenario_of, world_facts, world_query
from protocol.bus.bus import Bus
from protocol.bus.session import listens
from protocol.topics import STATUS, TRUTH
from runtime.clock import WallClock
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_S
from verification.harness.figures import Figure, Report

ECHO_NS: Final = 100 * NS_PER_MS
"""Samples that arrive this soon after a kill were sent before it."""
LOOK_NS: Final = 2 * NS_PER_MS
PATIENCE_NS: Final = 15_000 * NS_PER_MS
SETTLED_NS: Final = 700 * NS_PER_MS
ROUTER_S: Final = 1.0
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


def measure(options: argparse.Namespace) -> Report:
    """Kill each process repeatedly, and report the recovery times."""
    figures: list[Figure] = []
    for role, router in ROLES:
        with running(router=router) as (stack, arrivals, clock):
            took = [recovered(stack, arrivals, clock, role) for _ in range(options.repetitions)]
        name = role.partition(" ")[0] + (" behind a router" if router and role != "router" else "")
        figures += of(name, took, ROUTER_S if role == "router" else None)
    return Report(
        benchmark="restarts",
        figures=tuple(figures),
        notes=("SIGKILL; publishing: the robot's status and the plant's truth, from outside",),
    )


def of(name: str, took: list[Recovery], most_s: float | None) -> list[Figure]:
    """Return the figures of a process; `most_s` limits the time after its restart."""
    received = tuple(one.received_s for one in took)
    found = [Figure(name=f"{name}, kill to all publishing", unit="s", values=received)]
    if most_s is not None:
        healing = tuple(one.received_s - one.listens_s for one in took)
        found.append(
            Figure(
                name=f"{name}, listening to all publishing",
                unit="s",
                values=healing,
                at_most=most_s,
            )
        )
    return found


@contextmanager
def running(
    *, router: bool, policy: RestartPolicy = NO_PAUSE, clock_name: str = WALL
) -> Iterator[tuple[Stack, ArrivalTimes, WallClock]]:
    """Run robot and plant at rest, supervised as by `up` but without a restart limit."""
    clock = WallClock()
    words = ["up", "--clock", clock_name, "--world", "open", *(["--router"] if router else [])]
    options = parse(words)
    scenario = scenario_of(options, world_facts(command(world_query(options), os.getpid())))
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


def await_both(stack: Stack, arrivals: ArrivalTimes, clock: WallClock, since_ns: int) -> int:
    """Wait until both were received after a time, and return that time."""
    while not arrivals.both_since(since_ns):
        stack.check()
        if clock.now_ns() - since_ns > PATIENCE_NS:
            raise RemoteError(f"robot or plant not received within {PATIENCE_NS / NS_PER_S:g} s")
        clock.sleep_until(clock.now_ns() + LOOK_NS)
    return clock.now_ns()
