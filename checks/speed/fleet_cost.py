"""A fleet as `up` starts it: its speed in lockstep, its missed ticks in wall time, and its cost.

The cost of a tick is the processor time of all processes, the operator's included. It hardly
depends on what else the computer does, while the speed does. A model with three numbers describes
it: a share of the fleet, one of each robot, one of each robot process (a link). The page has its
error at each size, and at one fleet that is divided otherwise.

A fleet also crosses a warehouse to its goals, and one is placed on the workers of a Dask cluster on
this computer, with a delay between their routers as between computers.
"""

import argparse
import asyncio
import os
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import Final, NamedTuple

import numpy as np

from checks.harness.figures import BenchmarkReport, Figure, figure
from checks.harness.processes import cpu_s
from checks.harness.relays import TcpProxy
from checks.speed.fleet import driving_fleet, missed_in
from examples import dask_fleet
from ground.cli.main import parse
from ground.cli.run.up import connect, free_endpoint
from ground.launch.fleet_run import FleetRun, goal_runs_of
from ground.launch.launcher import Stack
from ground.launch.scenario import run_of, scenario_of
from plant.corpus import generate
from plant.world.writer import dumps
from protocol.outcome import RunOutcome
from runtime.clock import WallClock
from runtime.units import CONTROL_HZ, PERIOD_MS
from study.runner.workers import cluster

LEAST_SPEED: Final = {12: 5.0, 100: 0.4}
"""Times real time, by the number of robots."""

DIVIDED: Final = 8
"""Robots that are driven in one process, so that the share of a link shows."""

WALL_ROBOTS: Final = 30
PLACED: Final = 12
ARRIVE_S: Final = 300.0
ON_PAPER: Final = 1000
OPERATOR: Final = "operator"
HALL: Final = """\
name = "hall"
size_m = [40.0, 30.0]
start = { x_m = 4.0, y_m = 15.0, heading_deg = 0.0 }
goal = { x_m = 36.0, y_m = 15.0 }
"""


class FleetCost(NamedTuple):
    """Robots and their processes, speed, and processor time of a tick by kind of process, in ms."""

    robots: int
    processes: int
    speed: float
    tick_ms: dict[str, float]

    @property
    def whole_ms(self) -> float:
        """Processor time of a tick, of all processes."""
        return sum(self.tick_ms.values())


class CostModel(NamedTuple):
    """Processor time of a tick: of the fleet, of each robot, and of each robot process, in ms."""

    fleet_ms: float
    robot_ms: float
    process_ms: float

    def tick_ms(self, robots: int, processes: int) -> float:
        """Return the processor time of a tick."""
        return self.fleet_ms + robots * self.robot_ms + processes * self.process_ms


def model_of(costs: Sequence[FleetCost]) -> CostModel:
    """Return the model whose relative errors have the least sum of squares."""
    rows = [(1.0, cost.robots, cost.processes) for cost in costs]
    scale = np.array([cost.whole_ms for cost in costs])
    found = np.linalg.lstsq(np.array(rows) / scale[:, None], np.ones(len(costs)), rcond=None)
    return CostModel(*found[0].tolist())


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--robots", type=int, nargs="+", default=[1, 8, 10, 12, 30, 100])
    parser.add_argument("--plants", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated, of each (10)")
    parser.add_argument("--wall", type=float, default=60.0, help="seconds in wall time (60)")
    text = "robots that cross a warehouse (100)"
    parser.add_argument("--warehouse", type=int, default=100, help=text)
    text = "ms from worker to worker of a Dask cluster (0 1 5 20)"
    parser.add_argument("--delays", type=float, nargs="*", default=[0, 1, 5, 20], help=text)


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Drive fleets of these sizes in lockstep, and one in wall time."""
    with TemporaryDirectory() as folder:
        world = Path(folder) / "hall.toml"
        world.write_text(HALL, encoding="utf-8")
        plants = options.plants
        costs = [driven(world, robots, plants, options.seconds)[0] for robots in options.robots]
        shared, _ = driven(world, DIVIDED, 1, options.seconds, "--processes", "1")
        figures = [one for cost in costs for one in figures_of(cost)]
        figures += [missed_figure(world, options.wall)] if options.wall else []
        if options.warehouse:
            figures += warehouse_figures(Path(folder) / "warehouse.toml", options.warehouse, plants)
        if options.delays:
            figures += placed_figures(world, options.delays, options.seconds)
    costs.append(shared)
    notes = notes_of(costs, model_of(costs), plants)
    return BenchmarkReport(benchmark="fleet", figures=tuple(figures), notes=notes)


def driven(
    world: Path, robots: int, plants: int, seconds: float, *more: str
) -> tuple[FleetCost, list[RunOutcome]]:
    """Drive robots side by side in lockstep, for at most so many simulated seconds."""
    words = ["up", "--headless", "--no-record", "--router", "--world", str(world), "--speed", "max"]
    words += ["--robots", str(robots), "--plants", str(min(plants, robots))]
    options = parse([*words, "--timeout", str(seconds), *more])
    scenario, clock = scenario_of(options, run_of(options)), WallClock()
    with Stack(options, scenario, free_endpoint(), clock) as stack:
        stack.start(paused=True)
        with connect(stack.common, clock, stack.check) as bus:
            runs = goal_runs_of(scenario, stack.common, bus, clock, stack.check)
            before: Counter[str] = Counter()
            run = FleetRun(runs, clock, stack.check, lambda _: None)
            launched = lambda: before.update(spent_ms(stack))  # noqa: E731
            outcomes = asyncio.run(run.run(lockstep=True, launched=launched))
            spent = spent_ms(stack)
    ticks = max(outcome.time_s for outcome in outcomes) * CONTROL_HZ
    cost = FleetCost(
        robots=robots,
        processes=len(scenario.hosts),
        speed=speed_of(outcomes),
        tick_ms={kind: (ms - before[kind]) / ticks for kind, ms in spent.items()},
    )
    return cost, outcomes


def speed_of(outcomes: Sequence[RunOutcome]) -> float:
    """Return simulated time over wall time, to the end of the last drive."""
    return max(one.time_s for one in outcomes) / max(one.wall_s for one in outcomes)


def warehouse_figures(file: Path, robots: int, plants: int) -> list[Figure]:
    """Let robots cross a warehouse; return how many arrived, when, and what they touched."""
    file.write_text(dumps(generate("warehouse", 0, 1)), encoding="utf-8")
    cost, outcomes = driven(file, robots, plants, ARRIVE_S)
    name = f"{robots} robots in a warehouse"
    arrived = [one.time_s for one in outcomes if one.outcome == "reached"]
    contacts = sum(one.contacts for one in outcomes)
    return [
        figure(f"{name}, arrived", len(arrived), "robots", at_least=robots),
        figure(f"{name}, contacts", contacts, "contacts", at_most=0),
        figure(f"{name}, time to the goal", arrived, "s"),
        figure(f"{name}, real time", cost.speed, "x"),
    ]


def placed_figures(world: Path, delays_ms: Sequence[float], seconds: float) -> list[Figure]:
    """Drive robots on two Dask workers of this computer, with each delay between their routers."""
    from distributed import LocalCluster

    words = ["--world", str(world), "--robots", str(PLACED), "--speed", "max"]
    words += ["--timeout", str(seconds)]
    figures = []
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as local,
        cluster(local.scheduler_address) as client,
    ):
        for delay_ms in delays_ms:
            with ExitStack() as scope:
                through = partial(delayed, scope, delay_ms)
                _, outcomes = dask_fleet.drive(client, words, through)
            name = f"{PLACED} robots on 2 Dask workers, {delay_ms:g} ms between them, real time"
            figures.append(figure(name, speed_of(outcomes), "x"))
    return figures


def delayed(
    scope: ExitStack, delay_ms: float, parts: dask_fleet.Parts, hub: str
) -> dask_fleet.Parts:
    """Return the parts of the workers after the first with a delay on their way to its router."""
    if not delay_ms:
        return parts
    hub_there = scope.enter_context(TcpProxy(hub, delay_s=delay_ms / 1e3)).endpoint
    first, *others = parts
    return [
        first,
        *(
            [[hub_there if one == hub else one for one in words] for words in part]
            for part in others
        ),
    ]


def spent_ms(stack: Stack) -> dict[str, float]:
    """Return the processor time of the processes so far, by kind, in ms."""
    spent = {OPERATOR: time.process_time() * 1e3}
    for role, pid in stack.processes().items():
        kind = role.split()[0].rstrip("s")
        spent[kind] = spent.get(kind, 0.0) + cpu_s(pid) * 1e3
    return spent


def missed_figure(world: Path, seconds: float) -> Figure:
    """Return the ticks that a fleet misses in wall time."""
    with driving_fleet(WALL_ROBOTS, world.parent, str(world)) as fleet:
        Event().wait(5.0)
        missed = missed_in(fleet, seconds)
    return figure(
        f"{WALL_ROBOTS} robots in wall time, missed in {seconds:g} s", missed, "ticks", at_most=0
    )


def figures_of(cost: FleetCost) -> list[Figure]:
    """Return speed and cost of a fleet, and the speed that its cost permits."""
    name, cores = f"{cost.robots} robots in lockstep", os.cpu_count() or 1
    least = LEAST_SPEED.get(cost.robots)
    bound = cores * PERIOD_MS / cost.whole_ms
    return [
        figure(f"{name}, real time", cost.speed, "x", at_least=least),
        figure(f"{name}, bound by CPU of {cores} cores", bound, "x"),
        figure(f"{name}, CPU of a tick", cost.whole_ms, "ms"),
    ]


def notes_of(costs: list[FleetCost], model: CostModel, plants: int) -> tuple[str, ...]:
    """Return the parts of the cost, the model with its errors, and the fleet on paper."""
    parts = [
        f"{cost.robots} robots in {cost.processes} processes: "
        + ", ".join(f"{kind} {ms:.1f} ms" for kind, ms in cost.tick_ms.items())
        for cost in costs
    ]
    checked = [
        f"{cost.robots} in {cost.processes}: {model.tick_ms(cost.robots, cost.processes):.1f} ms"
        f" ({100.0 * (model.tick_ms(cost.robots, cost.processes) / cost.whole_ms - 1.0):+.0f} %)"
        for cost in costs
    ]
    processes = ON_PAPER // 25
    paper_ms = model.tick_ms(ON_PAPER, processes)
    return (
        f"plants: {plants}; CPU of a tick by kind of process:",
        *parts,
        f"model: {model.fleet_ms:.2f} ms + robots x {model.robot_ms:.3f} ms"
        f" + robot processes x {model.process_ms:.3f} ms a tick; cores = rate in Hz x ms / 1000",
        f"model at {', '.join(checked)}",
        f"on paper: {ON_PAPER} robots in {processes} processes: {paper_ms:.0f} ms a tick,"
        f" {paper_ms * CONTROL_HZ / 1e3:.0f} cores at {CONTROL_HZ:g} Hz",
    )
