"""A supervisor in a process of its own, to measure its growth and that of its plant.

`python -m checks.endurance.supervised PARENT WORLD` starts a robot and a plant as `up` does,
prints the plant's process id, kills the robot once a minute, and restarts it until its standard
input ends. The plant of the fleet is killed too often to be judged.
"""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from typing import IO, Final, Self

from ground.cli.main import parse
from ground.cli.run.up import free_endpoint
from ground.launch.child_command import command, die_with_parent
from ground.launch.child_processes import Children
from ground.launch.restart_policy import RestartSchedule
from ground.launch.scenario import process_arguments, scenario_of, world_facts, world_query
from ground.launch.supervisor import Supervisor
from runtime.clock import Clock, WallClock

ROUND_S: Final = 0.1
KILL_NS: Final = 60_000_000_000
SUPERVISOR: Final = "supervisor"
PLANT: Final = "plant that is left alone"
VICTIM: Final = "robot r1"


class Supervised:
    """The supervisor process as its parent sees it; `pids` has the ids by name."""

    def __init__(self, world: str) -> None:
        words = [sys.executable, "-m", "checks.endurance.supervised", str(os.getpid()), world]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.pids: Mapping[str, int] = {}

    def __enter__(self) -> Self:
        out: IO[bytes] | None = self._process.stdout
        assert out is not None
        line = out.readline()
        if not line:
            raise RuntimeError("the supervisor did not start")
        self.pids = {SUPERVISOR: self._process.pid, PLANT: json.loads(line)["plant"]}
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()


def supervise(upkeep: Supervisor, children: Children, clock: Clock, over: threading.Event) -> None:
    """Restart what ends, and kill the robot once a minute."""
    killed_ns = clock.now_ns()
    while not over.wait(ROUND_S):
        now_ns = clock.now_ns()
        if now_ns - killed_ns >= KILL_NS:
            killed_ns = now_ns
            children.send(VICTIM, signal.SIGKILL)
        upkeep.round(now_ns)
        upkeep.next_event()


def await_end(over: threading.Event) -> None:
    """Set `over` when standard input ends."""
    sys.stdin.read()
    over.set()


def main(arguments: Sequence[str]) -> int:
    """Supervise a robot and a plant until standard input ends; return the exit code."""
    parent, world = arguments
    if not die_with_parent(int(parent)):
        return 1
    options = parse(["up", "--headless", "--clock", "wall", "--world", world])
    facts = world_facts(command(world_query(options), os.getpid()))
    words = dict(process_arguments(scenario_of(options, facts), free_endpoint()))
    clock, over = WallClock(), threading.Event()
    with Children(clock) as children:
        for role, line in words.items():
            children.start(role, line)
        pids = dict(zip(children.roles, children.pids, strict=True))
        print(json.dumps({"plant": pids["plant"]}), flush=True)
        threading.Thread(target=await_end, args=(over,), daemon=True).start()
        upkeep = Supervisor(
            children, RestartSchedule(words), None, lambda role, _cause: words[role]
        )
        supervise(upkeep, children, clock, over)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
