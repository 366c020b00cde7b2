"""Processes of the stack for a measurement: their start, requests and cost, and runs in lockstep.

Busy processes only compute, at normal priority, until the block ends. Each one has a session of its
own, because Linux may share the processors between sessions instead of processes. Each one also
ends when the process that started it ends in any way.
"""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic, monotonic_ns, perf_counter
from typing import Any, Final, NamedTuple, Self

from checks.harness.until import PATIENCE_S, until
from ground.launch.child_command import die_with_parent
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network, Tls
from protocol.bus.publisher import Publisher
from protocol.outcome import WireGoal, start_arguments
from protocol.topics import COMMAND, RUN, STATUS, Role, Service
from protocol.wire.codec import decode
from protocol.wire.enums import (
    AUTOPILOT_INVALID,
    TYPE_GCS,
    AckResult,
    Command,
    GoalState,
    Mode,
    RunAction,
)
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    Heartbeat,
    NavigatorStatus,
    RunRequest,
    RunScore,
)
from protocol.world import World
from robot.core.parameters import DEFAULTS
from runtime.clock import WallClock
from runtime.config import totals_arguments
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_S
from study.trial.trial import Trial, params_of, wire_goal_of

ATTEMPT_S: Final = 0.5
OPERATOR_BEAT: Final = Heartbeat(
    type=TYPE_GCS, autopilot=AUTOPILOT_INVALID, base_mode=0, custom_mode=0, system_status=4
)


def command_request(
    request_id: int, command: int, param1: float = 0.0, param2: float = 0.0, stop_id: int = 0
) -> CommandRequest:
    """Return a COMMAND_REQUEST; what a command does not use is 0."""
    return CommandRequest(
        request_id=request_id, command=command, param1=param1, param2=param2, stop_id=stop_id
    )


def arm_request(request_id: int) -> CommandRequest:
    """Return the request that arms a robot."""
    return command_request(request_id, Command.COMPONENT_ARM_DISARM, 1.0)


def auto_goal_request(request_id: int, goal: WireGoal) -> GoalRequest:
    """Return the request to drive to a goal without an operator."""
    return GoalRequest(request_id=request_id, mode=Mode.AUTO, **goal._asdict())


def is_accepted(answer: object) -> bool:
    """Return whether an answer acknowledges a request as accepted."""
    return isinstance(answer, CommandAck) and answer.result == AckResult.ACCEPTED


def ask_until_accepted(
    bus: Bus, service: Service, request: Callable[[], Message], robot: str, within_s: float
) -> None:
    """Repeat a request until it is accepted; RuntimeError with the last answer after `within_s`."""
    deadline_s = monotonic() + within_s
    answer: object = None
    while monotonic() < deadline_s:
        try:
            answer = bus.ask(service, request(), ATTEMPT_S, robot)
        except NoAnswerError as error:
            answer = error
        if is_accepted(answer):
            return
    raise RuntimeError(f"{service.path} not accepted within {within_s:g} s: {answer!r}")


def await_subscribers(bus: Bus, publishers: Sequence[Publisher[Any]], within_s: float) -> None:
    """Wait until each publisher has a subscriber; RuntimeError with the keys that have none."""
    missing = bus.await_matched(publishers, within_s)
    if missing:
        raise RuntimeError(f"no subscriber within {within_s:g} s for {', '.join(missing)}")


VALID: Final = timedelta(days=1)

ROBOT: Final = "r1"


class Running:
    """A process, and what it has written so far, on either output."""

    def __init__(
        self,
        words: Sequence[str],
        *,
        environment: Mapping[str, str] | None = None,
        terminal: int | None = None,
        has_session: bool = True,
    ) -> None:
        """Start it, in a session of its own; with a terminal it reads and writes there.

        `environment` is added to that of this process.
        """
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - closed when it ends
        self.process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL if terminal is None else terminal,
            stdout=self._output if terminal is None else terminal,
            stderr=self._output if terminal is None else terminal,
            env={**os.environ, **(environment or {})},
            start_new_session=has_session,
        )

    @property
    def pid(self) -> int:
        """The process id."""
        return self.process.pid

    @property
    def said(self) -> str:
        """What it has written so far."""
        return os.pread(self._output.fileno(), 1 << 20, 0).decode(errors="replace")

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self.process.send_signal(number)

    def ends(self, within_s: float = PATIENCE_S) -> int:
        """Return its exit code; RuntimeError when it does not end in time."""
        try:
            return self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"still there after {within_s:g} s: {self.said}") from None

    def says(self, words: str, within_s: float = PATIENCE_S) -> None:
        """Wait until it has written these words; RuntimeError if it ends before, or is late."""
        until(
            lambda: words in self.said or self.process.poll() is not None,
            lambda: f"{words}: {self.said}",
            within_s,
        )
        if words not in self.said:
            raise RuntimeError(f"it ended before it wrote {words!r}: {self.said}")

    def close(self) -> None:
        """Kill it, unless it has ended."""
        self.process.kill()
        self.process.wait()
        self._output.close()


@contextmanager
def sidestep(
    *arguments: str,
    ready: str,
    environment: Mapping[str, str] | None = None,
    program: Sequence[str] = ("sidestep",),
) -> Iterator[Running]:
    """Run `sidestep ...` until the block ends; a line with `ready` reports that it is ready.

    `environment` is added to that of this process. `program`: another module to run in its place,
    with its first arguments.
    """
    words = [sys.executable, "-m", *program, *arguments]
    with closing(Running(words, environment=environment, has_session=False)) as running:
        try:
            running.says(ready)
            yield running
        finally:
            running.process.terminate()
            running.process.wait()


LAST_S: Final = 20.0
LAST_WORDS: Final = 500


class ToldProcess:
    """A module that prints a line when it is ready, and obeys its standard input until that ends.

    `is_nice`: it runs at a lower priority, as what would use another machine in reality. After its
    end, `last` is what else it printed, and `errors` the end of its standard error.
    """

    def __init__(self, module: str, *arguments: str, is_nice: bool = False) -> None:
        words = [sys.executable, "-m", module, *arguments]
        self.last = self.errors = ""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed when it ends
        self._child = subprocess.Popen(
            ["nice", *words] if is_nice else words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        assert self._child.stdout is not None
        if not self._child.stdout.readline():
            self.end()
            raise RuntimeError(f"{module} {arguments[0]} did not begin: {self.errors}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def go(self) -> None:
        """Tell it to begin, or to resume."""
        self._tell("go")

    def hold(self) -> None:
        """Tell it to pause."""
        self._tell("hold")

    def end(self) -> None:
        """End the process and read what it printed; kill a process that does not end."""
        try:
            self.last, _ = self._child.communicate(timeout=LAST_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self.last, _ = self._child.communicate()
        self.errors = os.pread(self._errors.fileno(), 1 << 20, 0).decode()[-LAST_WORDS:]
        self._errors.close()

    def _tell(self, word: str) -> None:
        assert self._child.stdin is not None
        with suppress(BrokenPipeError):
            self._child.stdin.write(f"{word}\n")
            self._child.stdin.flush()


TURN_NS: Final = NS_PER_S // 200
BURST_S: Final = 0.1


class SendingControl:
    """What a process that sends is told: go, hold, or the end of its input."""

    def __init__(self) -> None:
        self.on = threading.Event()
        self.over = False

    def read(self) -> None:
        """Read standard input until it ends."""
        for line in sys.stdin:
            if line.strip() == "go":
                self.on.set()
            else:
                self.on.clear()
        self.over = True
        self.on.set()


def send_when_told(send: Callable[[], object], rate_hz: float) -> int:
    """Be a process that sends at a rate while it is told to; return how often, at its end."""
    control, clock, total = SendingControl(), WallClock(), 0
    print("ready", flush=True)
    threading.Thread(target=control.read, daemon=True).start()
    while not control.over:
        control.on.wait()
        begun_ns, sent = clock.now_ns(), 0
        while control.on.is_set() and not control.over:
            due = round((clock.now_ns() - begun_ns) / NS_PER_S * rate_hz)
            for _ in range(min(due - sent, max(1, round(rate_hz * BURST_S)))):
                send()
                total += 1
            sent = due
            clock.sleep_until(clock.now_ns() + TURN_NS)
    return total


class StartedRobot(NamedTuple):
    """A `sidestep run robot` process, and the network settings that reach it."""

    pid: int
    output: list[str]
    network: Network


@contextmanager
def robot_process(
    world: World, *options: str, keys: Path | None = None, client: str = "router"
) -> Iterator[StartedRobot]:
    """Run a robot at the start of a world.

    With `keys`, a folder of `sidestep keys new`, access is controlled, and `client` is the role
    whose certificate `network` has. The router's certificate allows the plant and the operator.
    """
    endpoint = f"{'tls' if keys else 'tcp'}/127.0.0.1:{free_port()}"
    start = start_arguments(world.start.x_m, world.start.y_m, world.start.heading_rad)
    locked = ("--config", str(keys / f"robot-{ROBOT}.toml")) if keys else ()
    arguments = (
        "run",
        "robot",
        "--id",
        ROBOT,
        "--listen",
        endpoint,
        "--start",
        *start,
        *options,
        *locked,
    )
    with sidestep(*arguments, ready="ready") as robot:
        tls = tls_of(keys, client) if keys else None
        network = Network(mode="client", connect=(endpoint,), tls=tls)
        yield StartedRobot(robot.pid, robot.said.splitlines(), network)


def tls_of(keys: Path, role: str) -> Tls:
    """Return the certificate of a role, out of a folder of `sidestep keys new`."""
    certificate, key = str(keys / f"{role}.pem"), str(keys / f"{role}.key")
    return Tls(ca=str(keys / "ca.pem"), certificate=certificate, key=key)


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    """Return a loopback port of a kind of sockets that no process uses at the moment."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def made_keys(folder: Path, operators: Sequence[str] = ()) -> Path:
    """Create a folder of certificates for the robots r1 and r2, valid for a day, and return it."""
    # Imported here because other measurements run without its library.
    from ground.certificates import make

    now = datetime.now(UTC)
    make(folder, ["r1", "r2"], {}, now - VALID, now + VALID, operators)
    return folder


def cpu_s(pid: int) -> float:
    """Return the user and system time of all threads of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process in MiB."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise RuntimeError(f"process {pid} has no resident memory")


ACCEPTED_S = 100.0
STATUS_S = 60.0


class LockstepRun(NamedTuple):
    """A run to the end of its goal: the plant's score, and the wall time it took."""

    score: RunScore
    wall_s: float

    @property
    def digest(self) -> str:
        """The digest of the true trajectory, in hexadecimal."""
        return bytes(self.score.digest).hex()

    @property
    def pace(self) -> float:
        """Simulated time over wall time."""
        return self.score.ticks * 0.05 / self.wall_s


def lockstep_run(file: str, trial: Trial, *, router: bool = False) -> LockstepRun:
    """Run a trial over the bus instead of in one process; `file` names the file of its world."""
    with stack(file, trial, router=router) as processes:
        return GoalDriver(processes.bus).drive(trial.world)


class Processes(NamedTuple):
    """The running processes of a trial: a bus to them, and their ids by role."""

    bus: Bus
    pids: dict[str, int]


@contextmanager
def stack(
    file: str,
    trial: Trial,
    *,
    router: bool,
    program: Callable[[str], tuple[str, ...]] = lambda _: ("sidestep",),
) -> Iterator[Processes]:
    """Run the processes of a trial and open a bus to them.

    `program` returns the Python module that runs the verb of a role, with its first arguments.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as processes:
        if router:
            processes.enter_context(
                sidestep("run", "router", "--listen", endpoint, ready="router at")
            )
        dials = "--connect" if router else "--listen"
        robot = processes.enter_context(
            sidestep(*robot_words(trial), dials, endpoint, ready="ready", program=program("robot"))
        )
        words = (*plant_words(file, trial), "--connect", endpoint)
        plant = processes.enter_context(sidestep(*words, ready="plant:", program=program("plant")))
        network = Network(mode="client", connect=(endpoint,))
        bus = processes.enter_context(open_bus(network, Role.GROUND, ROBOT))
        yield Processes(bus, {"plant": plant.pid, "robot": robot.pid})


def robot_words(trial: Trial) -> Iterator[str]:
    """Yield the command line of a robot with the start and parameters of a trial."""
    start = trial.world.start
    yield from ("robot", "--id", ROBOT, "--lockstep")
    yield from ("--start", *start_arguments(start.x_m, start.y_m, start.heading_rad))
    yield from totals_arguments(trial.world.robot)
    params = params_of(trial)
    for name in params._fields:
        value = getattr(params, name)
        if value != getattr(DEFAULTS, name):
            yield from ("--param", f"{name}={value!r}")


def plant_words(file: str, trial: Trial) -> Iterator[str]:
    """Yield the command line of a plant with the world, seed and noise of a trial."""
    yield from ("plant", "--world", file, "--robots", ROBOT, "--lockstep", "--paused")
    yield from ("--seed", str(trial.seed))
    if trial.noise is not None:
        yield from ("--noise", trial.noise)


class GoalDriver:
    """Sends the goal between tick 0 and tick 1, and waits for its end."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._requests = count(monotonic_ns())
        self._frames: SimpleQueue[bytes] = SimpleQueue()
        bus.stream(STATUS, lambda _key, frame, _ns: self._frames.put(frame))

    def drive(self, world: World, started: Callable[[], None] = lambda: None) -> LockstepRun:
        """Drive to the goal of a world and return its score; call `started` at its beginning."""
        goal = wire_goal_of(world)
        self._ask(COMMAND, arm_request)
        self._ask(COMMAND, lambda number: auto_goal_request(number, goal))
        begun_s = perf_counter()
        self._ask(RUN, lambda _: RunRequest(action=RunAction.START, until_ns=0))
        started()
        ended_ns = self._end_of_goal()
        wall_s = perf_counter() - begun_s
        score = self._bus.ask(RUN, RunRequest(action=RunAction.SCORE, until_ns=ended_ns), 2.0)
        if not isinstance(score, RunScore):
            raise RuntimeError(f"the plant returned no score: {score!r}")
        return LockstepRun(score, wall_s)

    def _end_of_goal(self) -> int:
        while True:
            try:
                status = decode(self._frames.get(timeout=STATUS_S)).message
            except Empty:
                raise RuntimeError(f"no status from the robot for {STATUS_S:g} s") from None
            if isinstance(status, NavigatorStatus) and status.goal >= GoalState.REACHED:
                return status.goal_ended_ns

    def _ask(self, service: Service, request: Callable[[int], Message]) -> None:
        """Repeat a request until it is accepted: the processes need a moment to connect."""
        ask_until_accepted(
            self._bus, service, lambda: request(next(self._requests)), ROBOT, ACCEPTED_S
        )


def use_normal_priority() -> None:
    """Leave the idle and batch scheduling classes and a nice session, as far as this user may."""
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text("0")


@contextmanager
def busy(processes: int) -> Iterator[list[int]]:
    """Run so many busy processes; yield their process ids."""
    words = [sys.executable, "-m", "checks.harness.processes", str(os.getpid())]
    started: list[subprocess.Popen[bytes]] = []
    try:
        started.extend(
            subprocess.Popen(words, start_new_session=True) for _ in range(processes)
        )  # one by one, so that all are known when this is interrupted
        yield [process.pid for process in started]
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()


def compute(parent: int) -> None:
    """Compute until killed, or until the process `parent` ends."""
    use_normal_priority()
    if die_with_parent(parent):
        while True:
            pass


if __name__ == "__main__":
    compute(int(sys.argv[1]))
