"""Start, supervise and restart the processes of `up`, also in another world."""

import asyncio
import json
import signal
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from functools import partial
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, Final, Self

from ground.client.connection import Common
from ground.launch.child_processes import ChildExitError, Children
from ground.launch.fleet_run import FleetRun, goal_runs_of
from ground.launch.goal_run import NoOutcomeError
from ground.launch.recording_session import RECORDER, RecorderFiles
from ground.launch.scenario import (
    GATEWAY_ROLE,
    RunOptions,
    Scenario,
    process_arguments,
    run_of,
    scenario_of,
)
from ground.launch.supervisor import (
    PACED_SILENT_NS,
    ROUTER,
    SILENT_NS,
    HangDetector,
    RestartPolicy,
    RestartSchedule,
    Supervisor,
    VoidRun,
)
from ground.launch.tls_configs import check, dialling
from protocol.bus.bus import Bus
from protocol.bus.network import Network
from protocol.topics import GATEWAY, HEARTBEAT, TRUTH
from runtime.clock import Clock
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S
from runtime.watchdog import queued_ns

PROCESS_FAULTS: Final[Mapping[str, tuple[signal.Signals, str]]] = MappingProxyType(
    {
        "hang": (signal.SIGSTOP, "is frozen (SIGSTOP); its link stays open"),
        "wake": (signal.SIGCONT, "runs again (SIGCONT)"),
        "end": (signal.SIGKILL, "is killed (SIGKILL)"),
    }
)
"""Signal and effect of each fault that can be injected into a process."""


PAUSED: Final = "--paused"
LOCAL: Final = "127.0.0.1"
DIAL_S: Final = 0.5
CLOSE_NS: Final = 5 * NS_PER_S
CHANGED_WORLD: Final = "world.json"
"""File name only; the world's own name may come from anywhere."""


def free_address() -> str:
    """Return an address of this machine with a port that no datagrams use now."""
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind((LOCAL, 0))
        return f"{LOCAL}:{probe.getsockname()[1]}"


class Stack:
    """The processes of one `up`.

    The endpoint never changes, so clients find the processes again after a restart. Until
    `supervise` is called, the exit of any process ends the run. `on_change` is called when other
    processes run than before.
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
        self.endpoint = endpoint
        self.stop_at: dict[str, str] = {}
        """Where each robot receives stop datagrams, if not at the endpoint: behind a router."""

        self._further: list[str] = []
        """Endpoints of the routers after the first one."""

        self._clock = clock
        self._policy = policy
        self._children = Children(clock)
        self._roles: list[str] = []
        self._folder: TemporaryDirectory[str] | None = None
        self._supervisor: Supervisor | None = None
        self._bus: Bus | None = None
        self._recorder_files = RecorderFiles()
        self.on_change: Callable[[], None] = lambda: None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._children.stop()
        if self._folder is not None:
            self._folder.cleanup()

    @property
    def common(self) -> Common:
        """Connection settings of the first robot."""
        network = Network(
            mode="client",
            connect=(self.endpoint,),
            connect_timeout_s=DIAL_S,
            stop_at=self.stop_at,
        )
        locks = self.scenario.locks
        return Common(network=dialling(locks, network), robot=self.scenario.robots[0])

    def start(self, *, paused: bool = False, ready: Callable[[], None] = lambda: None) -> None:
        """Start all processes.

        `paused`: in lockstep, time waits for a request to start. `ready` is called when all but the
        plant have been started, so before any sensor data exist.
        """
        if self.scenario.record is not None:
            make_folder(self.scenario.record)
        commands = self._commands()
        self._roles = [name for name, _ in commands]
        check(self.scenario.locks, self._roles)
        plants = len(self.scenario.owners)
        for role, words in commands[:-plants]:
            self._children.start(role, self._kept(role, words))
        ready()
        for role, words in commands[-plants:]:
            its_words = words if paused else [word for word in words if word != PAUSED]
            self._children.start(role, its_words)
        self.on_change()

    def supervise(self, bus: Bus) -> None:
        """Restart processes that exit, and kill and restart those that hang, from now on."""
        self._bus = bus
        self._begin_supervision()
        for role, robots in self.scenario.hosts.items():
            for one in robots:
                bus.stream(HEARTBEAT, partial(self._note_message, role), one.robot)
        for role, names in self.scenario.owners.items():
            bus.stream(TRUTH, partial(self._note_message, role), names[0])
        if self.scenario.mavlink:
            for robot in self.scenario.robots:
                bus.stream(GATEWAY, partial(self._note_message, GATEWAY_ROLE), robot)

    def check(self) -> None:
        """Check all processes. Raises ChildExitError when one exited and is not restarted."""
        if self._supervisor is None:
            self._children.check()
            return
        self._supervise_once(self._supervisor)
        for why in self._supervisor.schedule.given_up.values():
            raise ChildExitError(why, 1)

    def check_for_late_exit(self) -> None:
        """Raise ChildExitError if an unsupervised process has exited or is about to."""
        if self._supervisor is None:
            self._children.check_for_late_exit()

    def end_recorders(self) -> bool:
        """Let the recorders close their files; return whether they did within 5 s."""
        roles = [role for role in self._children.roles if role.startswith(RECORDER)]
        return self._children.end(roles, CLOSE_NS)

    def recordings(self) -> list[Path]:
        """Return the .tlog files of this run, the newest last."""
        if self.scenario.record is not None:
            self._recorder_files.update(self._children, Path(self.scenario.record))
        return self._recorder_files.all

    def recording_of(self, robot: str) -> Path | None:
        """Return the newest .tlog of a robot of this run, or None if there is none yet."""
        self.recordings()
        return self._recorder_files.newest(robot)

    def next_event(self) -> str:
        """Return the next event of a process in words; empty when there is none."""
        if self._supervisor is None:
            return ""
        self._supervise_once(self._supervisor)
        return self._supervisor.next_event()

    def _supervise_once(self, supervisor: Supervisor) -> None:
        before = self._children.pids, self._recorder_files.all
        files = self.recordings()
        supervisor.round(self._clock.now_ns())
        if (self._children.pids, files) != before:
            self.on_change()

    def void(self, robot: str) -> VoidRun | None:
        """Return why a trial of this robot is void, or None while it counts.

        It needs all plants: when one has ended, the others end too, and the world begins anew.
        """
        if self._supervisor is None:
            return None
        hosts = self.scenario.hosts.items()
        role = next(role for role, robots in hosts if robot in [one.robot for one in robots])
        return self._supervisor.void((role, *self.scenario.owners), self._clock.now_ns())

    def restarted(self, scenario: Scenario, stopped: Callable[[], None] = lambda: None) -> None:
        """Stop all processes and start those of another scenario, within about a second.

        `stopped` is called when no process runs. In lockstep time waits for `drive_to_goals`.
        """
        self._children.stop()
        for role in self._roles:  # another run, which an operator has asked for
            rmtree(self._place() / role, ignore_errors=True)
        stopped()
        self.scenario = scenario
        self.start(paused=scenario.lockstep)
        if self._supervisor is not None:
            self._begin_supervision()
            for role in self._roles:
                self._detector.note_start(role, self._clock.now_ns())

    def drive_to_goals(self) -> list[str]:
        """Arm the robots, send their goals and start time; return the refusals.

        Call it after `restarted`, in a thread of its own: it waits for the processes. It raises
        NoOutcomeError if a robot does not accept its goal, or if another world was started.
        """
        scenario, bus = self.scenario, self._bus
        assert bus is not None, "set by supervise()"

        def check() -> None:
            if self.scenario is not scenario:
                raise NoOutcomeError(f"{scenario.name}: another world was started")

        goal_runs = goal_runs_of(scenario, self.common, bus, self._clock, check)
        run = FleetRun(goal_runs, self._clock, check, lambda _: None)

        async def launch() -> None:
            try:
                await run.launch(lockstep=scenario.lockstep)
            except RemoteError:
                with suppress(RemoteError):  # a robot that was stopped can still be driven
                    await goal_runs[0].start()
                raise

        try:
            asyncio.run(launch())
        finally:
            for goal_run in goal_runs:
                goal_run.close()
        return [f"{one.robot.name}: {one.refusal}" for one in goal_runs if one.refusal]

    def _begin_supervision(self) -> None:
        bus = self._bus
        assert bus is not None, "set by supervise()"
        robots = list(self.scenario.hosts)
        hub, now_ns = ROUTER if self.scenario.router else robots[0], self._clock.now_ns()
        silent_ns = PACED_SILENT_NS if self.scenario.lockstep else SILENT_NS
        roles, slow = (
            [*robots, *self.scenario.owners],
            [GATEWAY_ROLE] if self.scenario.mavlink else [],
        )
        self._detector = HangDetector(
            hub, roles, lambda: bus.hub().linked, now_ns, silent_ns, slow, self._queued_ns
        )
        self._supervisor = Supervisor(
            self._children,
            RestartSchedule(self._roles, self._policy),
            self._detector,
            self._arguments_of,
        )

    def _queued_ns(self, role: str) -> dict[str, int]:
        pid = self.processes().get(role)
        return {} if pid is None else queued_ns(pid)

    def _note_message(self, role: str, _key: str, _frame: bytes, at_ns: int) -> None:
        self._detector.note_message(role, at_ns)

    def _commands(self) -> list[tuple[str, list[str]]]:
        """Return role and arguments of each process; a robot keeps its place for stop datagrams."""
        while len(self._further) < self.scenario.routers - 1:
            self._further.append(f"tcp/{free_address()}")
        further = self._further[: self.scenario.routers - 1]
        commands = process_arguments(self.scenario, self.endpoint, *further)
        if self.scenario.router:
            hosts = self.scenario.hosts
            for role, words in commands:
                for one in hosts.get(role, ()):
                    at = self.stop_at.setdefault(one.robot, free_address())
                    words += ["--stop-at", at]
        return commands

    def _arguments_of(self, role: str, cause: str) -> list[str]:
        """Return the arguments for a restart: time goes on, and a robot reports the cause."""
        words = [word for word in dict(self._commands())[role] if word != PAUSED]
        if words[0] == "robot":
            words += ["--after", cause]
        return self._kept(role, words)

    def _kept(self, role: str, words: list[str]) -> list[str]:
        """Return the arguments of a process; a robot keeps its emergency stop over a restart."""
        if words[0] != "robot":
            return words
        shared = len(self.scenario.hosts[role]) > 1
        return [*words, "--stops", str(self._place() / role / ("{id}" if shared else ""))]

    def _place(self) -> Path:
        """Return the folder of this run, which ends with it."""
        if self._folder is None:
            self._folder = TemporaryDirectory(prefix="sidestep-")
        return Path(self._folder.name)

    def scenario_in(self, world: str, faults: Sequence[Mapping[str, object]] = ()) -> Scenario:
        """Return the scenario in another world with these faults added, or raise UserError."""
        options = copy(self._options)
        options.world, options.goal = world, None
        if faults:
            options.world = self._with(faults, run_of(options).facts)
        return scenario_of(options, run_of(options))

    def _with(self, faults: Sequence[Mapping[str, object]], facts: Mapping[str, Any]) -> str:
        """Write a file of the world with these faults added; return its path."""
        world = {name: value for name, value in facts.items() if name not in ("starts", "goals")}
        world["faults"] = [*facts.get("faults", ()), *faults]
        path = self._place() / CHANGED_WORLD
        path.write_text(json.dumps(world), encoding="utf-8")
        return str(path)

    def roles(self) -> list[str]:
        """Return the names of the processes in the order of their first start."""
        return self._roles

    def processes(self) -> dict[str, int]:
        """Return the process id of each role that runs."""
        return dict(zip(self._children.roles, self._children.pids, strict=True))

    def inject_fault(self, role: str, what: str) -> str:
        """Inject a fault into a process and return what was done, in words."""
        number, effect = PROCESS_FAULTS[what]
        if not self._children.send(role, number):
            raise UserError(f"there is no running {role} process")
        return f"the {role} process {effect}"


def make_folder(folder: str) -> None:
    """Create the folder for recordings, or raise UserError."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--record {folder}: {error.strerror}") from error
