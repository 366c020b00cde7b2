"""The fleet of a soak: the processes of `up`, two operators and a recorder; some behind proxies."""

import os
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final, NamedTuple, Self

from checks.endurance.faults import CUT, SoakFault
from checks.endurance.supervised import Supervised
from checks.flood.attackers import Access, Attack
from checks.harness.relays import TcpProxy
from ground.cli.main import parse
from ground.cli.run.up import free_endpoint
from ground.launch.child_command import command
from ground.launch.child_processes import Children
from ground.launch.restart_policy import RestartSchedule
from ground.launch.scenario import (
    Scenario,
    process_arguments,
    scenario_of,
    world_facts,
    world_query,
)
from ground.launch.supervisor import Supervisor
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from runtime.clock import Clock

LISTENS_S: Final = 15.0
PAGE_MB: Final = os.sysconf("SC_PAGESIZE") / 1e6


class Size(NamedTuple):
    """The resident memory, open files and threads of a process, from the kernel."""

    rss_mb: float
    files: float
    threads: float


class Fleet:
    """The processes of `up` with a router; those that end are restarted as `up` restarts them."""

    def __init__(self, world: str, robots: int, seed: int, folder: Path, clock: Clock) -> None:
        words = ["up", "--headless", "--clock", "wall", "--router", "--world", world]
        options = parse([*words, "--robots", str(robots), "--seed", str(seed)])
        facts = world_facts(command(world_query(options), os.getpid()))
        self.scenario: Scenario = scenario_of(options, facts)
        self.endpoint = free_endpoint()
        self._world = world
        self._folder = folder
        self._clock = clock
        self._scope = ExitStack()
        self._proxies: dict[str, TcpProxy] = {}
        self._words: dict[str, list[str]] = {}

    def __enter__(self) -> Self:
        with self._scope:
            self._attacks = self._scope.enter_context(ExitStack())
            self._children = self._scope.enter_context(Children(self._clock))
            self._words = self._cast()
            for role, words in self._words.items():
                self._children.start(role, words)
            supervisor = RestartSchedule(self._words)
            self._upkeep = Supervisor(self._children, supervisor, None, self._again)
            self._supervised = self._scope.enter_context(Supervised(self._world))
            network = Network(mode="client", connect=(self.endpoint,), connect_timeout_s=LISTENS_S)
            self.bus: Bus = self._scope.enter_context(open_bus(network, Role.GROUND, "r1"))
            self._scope = self._scope.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._scope.close()

    @property
    def roles(self) -> list[str]:
        """The names of the processes."""
        return list(self._words)

    @property
    def given_up(self) -> list[str]:
        """The messages about processes that ended too often."""
        return list(self._upkeep.schedule.given_up.values())

    def look_after(self) -> None:
        """Restart the processes that have ended."""
        self._upkeep.round(self._clock.now_ns())

    def do(self, fault: SoakFault) -> None:
        """Begin a fault."""
        if fault.flood_hz:
            self._attack(fault.flood_hz)
        elif fault.first is None:
            self._proxies[fault.role].cut()
        else:
            self._children.send(fault.role, fault.first)

    def undo(self, fault: SoakFault) -> None:
        """End a fault."""
        if fault.flood_hz:
            self._attacks.close()
        elif fault.first is None:
            self._proxies[fault.role].restore()
        elif fault.then is not None:
            self._children.send(fault.role, fault.then)

    def _attack(self, rate_hz: float) -> None:
        with suppress(RuntimeError):  # it could not connect
            attack = self._attacks.enter_context(Attack("frames", Access(self.endpoint), rate_hz))
            attack.go()

    def sizes(self) -> dict[tuple[str, int], Size]:
        """Return sizes by role and process id, without processes that have just ended."""
        found = {}
        children = zip(self._children.roles, self._children.pids, strict=True)
        for role, pid in (*children, *self._supervised.pids.items()):
            size = size_of(pid)
            if size is not None:
                found[role, pid] = size
        return found

    def _cast(self) -> dict[str, list[str]]:
        words = dict(process_arguments(self.scenario, self.endpoint))
        dials = ["--connect", self.endpoint, "--id"]
        words["recorder r1"] = ["record", str(self._folder), *dials, "r1"]
        for robot in self.scenario.robots[:2]:
            words[f"ground {robot}"] = ["ground", "--plain", *dials, robot]
        for role in CUT:
            proxy = self._proxies[role] = self._scope.enter_context(TcpProxy(self.endpoint))
            words[role] = [
                proxy.endpoint if word == self.endpoint else word for word in words[role]
            ]
        return words

    def _again(self, role: str, cause: str) -> list[str]:
        words = self._words[role]
        return [*words, "--after", cause] if words[0] == "robot" else words


def size_of(pid: int) -> Size | None:
    """Return the size of a process; None if it has ended or belongs to another user."""
    place = Path(f"/proc/{pid}")
    try:
        pages = int((place / "statm").read_text().split()[1])
        files, threads = (len(list((place / name).iterdir())) for name in ("fd", "task"))
    except (OSError, IndexError):
        return None
    return Size(pages * PAGE_MB, files, threads)
