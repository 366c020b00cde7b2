"""Drive a fleet on a Dask cluster: each worker gets a router, a plant and a part of the robots.

    python examples/dask_fleet.py tcp://HOST:8786 --robots 100 --speed max --world hall.toml

The words after the scheduler are those of `sidestep up`. Robots and their plant share a router, so
only what the plants tell each other passes between workers in each tick. There are no keys: every
program that reaches a router can command the robots. Everything ends with this program.
"""

import argparse
import asyncio
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from select import select
from tempfile import TemporaryDirectory
from typing import Any, Final
from urllib.parse import urlsplit

from ground.cli.main import parse
from ground.cli.run.up import connect, free_endpoint
from ground.client.connection import Common
from ground.launch.child_command import command
from ground.launch.fleet_run import FleetRun, goal_runs_of, in_words
from ground.launch.scenario import Scenario, process_arguments, run_of, scenario_of
from protocol.bus.network import Network
from protocol.outcome import RunOutcome
from runtime.clock import WallClock
from runtime.errors import RemoteError, UserError
from study.runner.workers import cluster

POLL_S: Final = 0.5
DIAL_S: Final = 0.5

Commands = list[list[str]]
Parts = list[Commands]
"""The command lines of each worker."""


def run_part(commands: Commands, world: str, text: str, until: tuple[str, int]) -> str:
    """Run processes on a worker; return which one ended, or that the connection `until` did.

    `text` is the file `world`, which may be on another computer; empty for a shipped world.
    """
    processes: list[subprocess.Popen[bytes]] = []
    with TemporaryDirectory() as folder, socket.create_connection(until) as line:
        copy = Path(folder) / "world.toml"
        copy.write_text(text, encoding="utf-8")
        try:
            for words in commands:
                own = [str(copy) if text and word == world else word for word in words]
                processes.append(subprocess.Popen(command(own, os.getpid())))
            while not select([line], [], [], POLL_S)[0]:
                for words, process in zip(commands, processes, strict=True):
                    if process.poll() is not None:
                        return f"{' '.join(words[:3])} ... ended with {process.returncode}"
        finally:
            for process in processes:
                process.kill()
            for process in processes:
                process.wait()
    return "the program that started it has ended"


def scenario_on(workers: int, words: Sequence[str]) -> Scenario:
    """Return the scenario of `up` with these words, in a part for each worker."""
    each = [word for what in ("--processes", "--plants", "--routers") for word in (what, workers)]
    options = parse(["up", "--headless", "--no-record", *words, *map(str, each)])
    return scenario_of(options, run_of(options))


def parts_of(scenario: Scenario, endpoints: Sequence[str]) -> Parts:
    """Return the processes of each worker, whose router listens at its endpoint."""
    commands = [words for _, words in process_arguments(scenario, *endpoints)]
    return [commands[number :: len(endpoints)] for number in range(len(endpoints))]


def drive(
    client: Any, words: Sequence[str], through: Callable[[Parts, str], Parts] = lambda p, _: p
) -> tuple[Scenario, list[RunOutcome]]:
    """Run the parts on the workers of a cluster, and drive all robots to their goals.

    `through` may change the parts, given the endpoint of the router that the others dial.
    """
    workers = sorted(client.scheduler_info(n_workers=-1)["workers"])
    scenario, clock = scenario_on(len(workers), words), WallClock()
    text = Path(scenario.world).read_text("utf-8") if Path(scenario.world).is_file() else ""
    on = partial(client.submit, pure=False)
    endpoints = [endpoint_at(one, on(free_endpoint, workers=[one]).result()) for one in workers]
    parts = through(parts_of(scenario, endpoints), endpoints[0])
    with socket.create_server((address_of(client), 0), backlog=len(workers)) as server:
        until = server.getsockname()[:2]
        running = [
            on(run_part, part, scenario.world, text, until, workers=[one])
            for part, one in zip(parts, workers, strict=True)
        ]

        def check() -> None:
            for one in running:
                if one.done():
                    raise RemoteError(one.result())

        network = Network(mode="client", connect=(endpoints[0],), connect_timeout_s=DIAL_S)
        common = Common(network=network, robot=scenario.robots[0])
        with connect(common, clock, check) as bus:
            runs = goal_runs_of(scenario, common, bus, clock, check)
            run = FleetRun(runs, clock, check, lambda _: None)
            outcomes = asyncio.run(run.run(lockstep=scenario.lockstep))
    for one in running:
        one.result()
    return scenario, outcomes


def endpoint_at(worker: str, endpoint: str) -> str:
    """Return an endpoint with the host of a worker and the port of the given one."""
    return f"tcp/{urlsplit(worker).hostname}:{endpoint.rpartition(':')[2]}"


def address_of(client: Any) -> str:
    """Return the address of this computer as the scheduler sees it."""
    scheduler = urlsplit(client.scheduler.address)
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.connect((scheduler.hostname, scheduler.port))
        return str(probe.getsockname()[0])


def main(argv: Sequence[str] | None = None) -> int:
    """Drive the fleet and print its outcomes; return 0 if all robots have arrived."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("scheduler", help="address of the cluster; all further words are of `up`")
    given, words = parser.parse_known_args(argv)
    try:
        with cluster(given.scheduler) as client:
            scenario, outcomes = drive(client, words)
    except (UserError, RemoteError) as error:
        print(error, file=sys.stderr)
        return 1
    print(in_words(scenario.robots, outcomes))
    return 0 if all(one.outcome == "reached" for one in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
