"""The processes of `up`: started together, looked after, and started anew in another world."""

import json
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, Final, Self

from ground.client.connection import Common
from ground.launch.child_command import command
from ground.launch.child_processes import ChildDied, Children
from ground.launch.hang_detector import ROUTER, HangDetector
from ground.launch.restart_policy import RestartPolicy, RestartSchedule
from ground.launch.scenario import RunOptions, Scenario, cast, question, scenario_of, world_facts
from ground.launch.supervisor import InvalidRun, Supervisor
from ground.launch.tls_configs import check, dialling
from protocol.bus.bus import Bus
from protocol.bus.network import Network
from protocol.topics import HEARTBEAT, TRUTH
from runtime.clock import Clock
from runtime.errors import UserError

TROUBLES: Final[Mapping[str, tuple[signal.Signals, str]]] = MappingProxyType(
    {
        "hang": (signal.SIGSTOP, "stands still as if it hung; its link stays"),
        "wake": (signal.SIGCONT, "goes on after that"),
        "end": (signal.SIGKILL, "is gone at once, without a word"),
    }
)
"""What can be done to a process that is ours, by name."""


PAUSED: Final = "--paused"
PLANT: Final = "plant"
DIAL_S: Final = 0.5
CHANGED_WORLD: Final = "world.json"
"""Not the name of the world, which may come from anywhere."""


class Stack:
    """Has one endpoint all its life, so that whoever has dialled it finds the next one there.

    Until somebody looks after them, a process that ends is the end of all.
    """

    def __init__(
        self,
        options: RunOptions,
        scenario: Scenario,
        endpoint: str,
        clock: Clock,
        policy: RestartPolicy | None = None,
    ) -> None:
        self._options = options
        self.scenario = scenario
        self._endpoint = endpoint
        self._clock = clock
        self._policy = policy
        self._children = Children(clock)
        self._roles: list[str] = []
        self._folder: TemporaryDirectory[str] | None = None
        self._upkeep: Supervisor | None = None
        self._hears: Bus | None = None
        self.logs_before: set[Path] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._children.stop()
        if self._folder is not None:
            self._folder.cleanup()

    @property
    def common(self) -> Common:
        """How its first robot is dialled."""
        network = Network(mode="client", connect=(self._endpoint,), connect_timeout_s=DIAL_S)
        locks = self.scenario.locks
        return Common(network=dialling(locks, network), robot=self.scenario.robots[0])

    def start(self, *, paused: bool = False, ready: Callable[[], None] = lambda: None) -> None:
        """`paused`: in lockstep, time waits until it is told to go on. `ready` is called when all
        but the plant have been started, and so before there is anything to sense."""
        if self.scenario.record is not None:
            make_folder(self.scenario.record)
            self.logs_before = set(Path(self.scenario.record).glob("*.tlog"))
        *first, (role, words) = everybody = cast(self.scenario, self._endpoint)
        self._roles = [name for name, _ in everybody]
        check(self.scenario.locks, self._roles)
        for before, its_words in first:
            self._children.start(before, its_words)
        ready()
        waits = paused or PAUSED not in words
        self._children.start(role, words if waits else [w for w in words if w != PAUSED])

    def look_after(self, bus: Bus) -> None:
        """From now on who dies is started again, and who hangs is ended and started again."""
        self._hears = bus
        self._begin_upkeep()
        for robot in self.scenario.robots:
            bus.stream(HEARTBEAT, partial(self._heard, f"robot {robot}"), robot)
            bus.stream(TRUTH, partial(self._heard, PLANT), robot)

    def check(self) -> None:
        """Look at all of them. Raise ChildDied when one has ended and will not come back."""
        if self._upkeep is None:
            self._children.check()
            return
        self._upkeep.round(self._clock.now_ns())
        for why in self._upkeep.supervisor.given_up.values():
            raise ChildDied(why, 1)

    def blame(self) -> None:
        """Raise ChildDied when one has ended that nobody looks after, or is about to."""
        if self._upkeep is None:
            self._children.blame()

    def news(self) -> str:
        """What has happened to one of them, each thing once; empty when there is nothing new."""
        if self._upkeep is None:
            return ""
        self._upkeep.round(self._clock.now_ns())
        return self._upkeep.news()

    def void(self, robot: str) -> InvalidRun | None:
        """Why a trial of this robot is none any more; None: it still counts."""
        if self._upkeep is None:
            return None
        return self._upkeep.void((f"robot {robot}", PLANT), self._clock.now_ns())

    def restarted(self, scenario: Scenario) -> None:
        """End them all and start those of another scenario, within about a second."""
        self._children.stop()
        self.scenario = scenario
        self.start()
        if self._upkeep is not None:
            self._begin_upkeep()
            for role in self._roles:
                self._hearts.started(role, self._clock.now_ns())

    def _begin_upkeep(self) -> None:
        bus = self._hears
        assert bus is not None, "somebody is heard"
        robots = [f"robot {robot}" for robot in self.scenario.robots]
        hub, now_ns = ROUTER if self.scenario.router else robots[0], self._clock.now_ns()
        self._hearts = HangDetector(hub, [*robots, PLANT], lambda: bus.hub().linked, now_ns)
        self._upkeep = Supervisor(
            self._children,
            RestartSchedule(self._roles, self._policy),
            None if self.scenario.lockstep else self._hearts,
            self._arguments_of,
        )

    def _heard(self, role: str, _key: str, _frame: bytes, at_ns: int) -> None:
        self._hearts.heard(role, at_ns)

    def _arguments_of(self, role: str, cause: str) -> list[str]:
        """Those of its first start; time goes on, and a robot tells why there was one before."""
        words = [word for word in dict(cast(self.scenario, self._endpoint))[role] if word != PAUSED]
        return [*words, "--after", cause] if words[0] == "robot" else words

    def scenario_in(self, world: str, faults: Sequence[Mapping[str, object]] = ()) -> Scenario:
        """What it would be in another world, with these faults added; UserError says why not."""
        options = copy(self._options)
        options.world, options.goal = world, None
        if faults:
            options.world = self._with(faults, self._facts(options))
        return scenario_of(options, self._facts(options))

    def _facts(self, options: RunOptions) -> dict[str, Any]:
        return world_facts(command(question(options), os.getpid()))

    def _with(self, faults: Sequence[Mapping[str, object]], facts: Mapping[str, Any]) -> str:
        """The file of a world that has these faults, too."""
        world = {name: value for name, value in facts.items() if name not in ("starts", "goals")}
        world["faults"] = [*facts.get("faults", ()), *faults]
        if self._folder is None:
            self._folder = TemporaryDirectory(prefix="sidestep-")
        path = Path(self._folder.name) / CHANGED_WORLD
        path.write_text(json.dumps(world), encoding="utf-8")
        return str(path)

    def roles(self) -> list[str]:
        """The names of the processes, in the order in which they were started first."""
        return self._roles

    def trouble(self, role: str, what: str) -> str:
        """Do something to one of them; what has been done, in words."""
        number, says = TROUBLES[what]
        if not self._children.send(role, number):
            raise UserError(f"the {role} process is not there")
        return f"the {role} process {says}"


def make_folder(folder: str) -> None:
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--record {folder}: {error.strerror}") from error
