"""From a kill until all is heard again: `up` starts anew who was killed, and the others find it.

The time counts from the signal. What a hub takes is the start of a Python process, and then the
next attempt of those that dial it.
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
from ground.launch.scenario import scenario_of, world_facts, world_query
from protocol.bus.bus import Bus
from protocol.bus.session import listens
from protocol.topics import STATUS, TRUTH
from runtime.clock import WallClock
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_S
from verification.harness.figures import Figure, Report

ECHO_NS: Final = 100 * NS_PER_MS
"""What is heard so soon after a kill was still on its way."""
LOOK_NS: Final = 2 * NS_PER_MS
PATIENCE_NS: Final = 15_000 * NS_PER_MS
SETTLED_NS: Final = 700 * NS_PER_MS
ROUTER_S: Final = 1.0
NO_PAUSE: Final = RestartPolicy(pause_ns=0, limit=1_000_000)
ROLES: Final = (("robot r1", False), ("plant", False), ("robot r1", True), ("router", True))


class Recovery(NamedTuple):
    """Seconds from the kill: until the hub takes calls, and until all is heard."""

    listens_s: float
    heard_s: float


class Ears:
    """When each of robot and plant was heard last."""

    def __init__(self, bus: Bus) -> None:
        self._heard_ns = {STATUS.path: 0, TRUTH.path: 0}
        for topic in (STATUS, TRUTH):
            bus.stream(topic, partial(self._hear, topic.path))

    def _hear(self, path: str, _key: str, _frame: bytes, at_ns: int) -> None:
        self._heard_ns[path] = at_ns

    def both_since(self, since_ns: int) -> bool:
        return min(self._heard_ns.values()) > since_ns


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--repetitions", type=int, default=20)


def measure(options: argparse.Namespace) -> Report:
    figures: list[Figure] = []
    for role, router in ROLES:
        with running(router=router) as (stack, ears, clock):
            took = [recovered(stack, ears, clock, role) for _ in range(options.repetitions)]
        name = role.partition(" ")[0] + (" behind a router" if router and role != "router" else "")
        figures += of(name, took, ROUTER_S if role == "router" else None)
    return Report(
        benchmark="restarts",
        figures=tuple(figures),
        notes=("SIGKILL; publishing: the robot's status and the plant's truth, from outside",),
    )


def of(name: str, took: list[Recovery], most_s: float | None) -> list[Figure]:
    """`most_s` is for what comes after the process itself is there."""
    heard = tuple(one.heard_s for one in took)
    found = [Figure(name=f"{name}, kill to all publishing", unit="s", values=heard)]
    if most_s is not None:
        healing = tuple(one.heard_s - one.listens_s for one in took)
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
    *, router: bool, policy: RestartPolicy = NO_PAUSE
) -> Iterator[tuple[Stack, Ears, WallClock]]:
    """Robot and plant standing in the open, looked after as `up` does but without any limit."""
    clock = WallClock()
    options = parse(["up", "--world", "open", *(["--router"] if router else [])])
    scenario = scenario_of(options, world_facts(command(world_query(options), os.getpid())))
    with Stack(options, scenario, free_endpoint(), clock, policy) as stack:
        stack.start()
        with connect(stack.common, clock, stack.check) as bus:
            ears = Ears(bus)
            await_both(stack, ears, clock, clock.now_ns())
            stack.supervise(bus)
            yield stack, ears, clock


def recovered(stack: Stack, ears: Ears, clock: WallClock, role: str) -> Recovery:
    """Kill one of them, and see the others find it."""
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
    heard_ns = await_both(stack, ears, clock, killed_ns + ECHO_NS)
    return Recovery((listens_ns - killed_ns) / NS_PER_S, (heard_ns - killed_ns) / NS_PER_S)


def await_both(stack: Stack, ears: Ears, clock: WallClock, since_ns: int) -> int:
    """When both had been heard since then."""
    while not ears.both_since(since_ns):
        stack.check()
        if clock.now_ns() - since_ns > PATIENCE_NS:
            raise RemoteError(f"not heard again within {PATIENCE_NS / NS_PER_S:g} s")
        clock.sleep_until(clock.now_ns() + LOOK_NS)
    return clock.now_ns()
