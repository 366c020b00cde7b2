"""Real processes of the stack, a witness, and their table."""

import os
import signal
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Self

from checks.harness.processes import free_port
from ground.launch.child_command import command
from ground.recording.log_reader import TlogReader
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import CYCLE, DRIVE, STATUS, TEXT, TRUTH, Role
from protocol.wire.codec import decode
from protocol.wire.enums import Vehicle
from protocol.wire.messages import (
    CycleReport,
    GroundTruth,
    NavigatorStatus,
    Statustext,
    WheelCommand,
)
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import NoPeerError, RemoteError
from runtime.units import NS_PER_MS
from tests.support.until import PATIENCE_S, until

STILL_M_S = 0.001
FAST_M_S = 0.25
DEPARTS_S = 60.0
TRIES = 3
BUSY_HUB = "does not answer (waited"
LATE = (Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.BUDGET)
LOCAL = "127.0.0.1"


def free_endpoint() -> str:
    return f"tcp/{LOCAL}:{free_port()}"


@dataclass
class Running:
    """One process and what it has written so far, on either output."""

    process: subprocess.Popen[bytes]
    output: IO[bytes]

    @property
    def said(self) -> str:
        return os.pread(self.output.fileno(), 1 << 20, 0).decode(errors="replace")

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def ends(self, within_s: float = PATIENCE_S) -> int:
        """Return its exit code; fail when it does not end in time."""
        try:
            return self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"still there after {within_s} s: {self.said}") from None

    def says(self, words: str, within_s: float = PATIENCE_S) -> None:
        deadline_s = time.monotonic() + within_s
        until(
            lambda: (
                words in self.said
                or self.process.poll() is not None
                or time.monotonic() > deadline_s
            ),
            within_s + 1.0,
        )
        assert words in self.said, self.said


class Crew:
    """Starts `sidestep` verbs at one endpoint; ends them all on the way out.

    In `lockstep` robot and plant have simulated time, at most as fast as real time: a busy machine
    slows them down and stops no robot. Without it they have wall time, and a robot may be late.
    """

    def __init__(self, *, router: bool = False, lockstep: bool = False) -> None:
        self.endpoint = free_endpoint()
        self._router = router
        self._lockstep = lockstep
        self._started: list[Running] = []
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        if self._router:
            with self._scope:  # closed here if the router does not come up
                self.router = self.listening("router")
                self.router.says("router at")
                self._scope = self._scope.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._scope.close()

    def execute(self, *words: str, terminal: int | None = None) -> Running:
        """Any command line, ended with the crew; with a terminal it writes there."""
        output = tempfile.TemporaryFile()  # noqa: SIM115 - closed on the way out
        self._scope.callback(output.close)
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL if terminal is None else terminal,
            stdout=output if terminal is None else terminal,
            stderr=output if terminal is None else terminal,
            start_new_session=True,
        )
        self._scope.callback(process.wait)
        self._scope.callback(process.kill)
        prefer(process.pid)
        self._started.append(Running(process, output))
        return self._started[-1]

    def start(self, *words: str) -> Running:
        """`sidestep` with these words."""
        return self.execute(*command(words, os.getpid()))

    def listening(self, *words: str) -> Running:
        return self.start(*words, "--listen", self.endpoint)

    def dialling(self, *words: str) -> Running:
        return self.start(*words, "--connect", self.endpoint)

    def robot(self, *words: str) -> Running:
        """Ready; without a router it is the hub."""
        start = self.dialling if self._router else self.listening
        own = ("--lockstep",) if self._lockstep else ()
        robot = start("robot", "--start", "0.6", "2", "0", *own, *words)
        robot.says("ready")
        self.in_real_time()
        return robot

    def plant(self, *words: str, waits: bool = True) -> Running:
        """Start the plant, which connects to the robot; with `waits`, wait until it is ready."""
        own = ("--lockstep", "--speed", "1") if self._lockstep else ()
        plant = self.dialling("plant", "--world", "open", "--noise", "none", *own, *words)
        if waits:
            plant.says("plant: world")
            self.in_real_time()
        return plant

    def in_real_time(self) -> None:
        """Schedule all that has been started so far in real time, if this user may."""
        for running in self._started:
            real_time(running.process.pid)

    def run(self, *words: str) -> tuple[int, str]:
        """Run a verb to its end, again if its hub was busy; return exit code and output."""
        for _ in range(TRIES):
            running = self.dialling(*words)
            code, said = running.ends(), running.said
            if BUSY_HUB not in said:
                break
        return code, said


class Witness:
    """Sees truth, status and texts as they arrive, each with the time of its arrival.

    What cannot be read is a mistake of the stack, unless it is not `strict`.
    """

    def __init__(self, endpoint: str, robot: str = "r1", *, strict: bool = True) -> None:
        self._network = Network(mode="client", connect=(endpoint,), connect_timeout_s=0.5)
        self._robot = robot
        self._strict = strict
        self.unreadable = 0
        self.truths: deque[tuple[GroundTruth, int]] = deque(maxlen=20_000)
        self.statuses: deque[tuple[NavigatorStatus, int]] = deque(maxlen=20_000)
        self.moving: deque[WheelCommand] = deque(maxlen=20_000)
        self.texts: list[str] = []
        self.report: CycleReport | None = None
        self.speeds: tuple[int, int] | None = None

    def __enter__(self) -> Self:
        self.bus: Bus = open_patiently(self._network, self._robot)
        for topic in (TRUTH, STATUS, TEXT, CYCLE, DRIVE):
            self.bus.stream(topic, self._take)
        return self

    def __exit__(self, *_: object) -> None:
        self.bus.close()
        assert not (self._strict and self.unreadable)

    def _take(self, _key: str, frame: bytes, arrived_ns: int) -> None:
        try:
            message = decode(frame).message
        except RemoteError:
            self.unreadable += 1
            return
        if isinstance(message, GroundTruth):
            self.truths.append((message, arrived_ns))
        elif isinstance(message, NavigatorStatus):
            self.statuses.append((message, arrived_ns))
        elif isinstance(message, Statustext):
            self.texts.append(message.text)
        elif isinstance(message, CycleReport):
            self.report = message
        elif isinstance(message, WheelCommand):
            self.speeds = (message.left_mrad_s, message.right_mrad_s)
            if any(self.speeds):
                self.moving.append(message)

    @property
    def status(self) -> NavigatorStatus:
        until(lambda: self.statuses, what="a status")
        return self.statuses[-1][0]

    @property
    def truth(self) -> GroundTruth:
        until(lambda: self.truths, what="the truth")
        return self.truths[-1][0]

    def ready(self) -> None:
        until(lambda: self.status.vehicle == Vehicle.STANDBY, what="STANDBY")

    def fast(self) -> bool:
        return self.truth.speed_m_s > FAST_M_S

    def was_late(self, since: int) -> bool:
        """Return whether a later status shows a stop that a busy machine can cause."""
        return any(
            status.vehicle == Vehicle.FAILSAFE and status.vehicle_reason in LATE
            for status, _ in tuple(self.statuses)[since:]
        )

    def driving(self) -> None:
        try:
            until(self.fast, what="driving")
        except AssertionError as error:
            raise AssertionError(f"{error}; {self.status}; {self.texts}") from None

    def standing(self) -> bool:
        return moved_not(self.truth)

    def rolled_on_ms(self) -> float:
        """Simulated time from the tick of the last command to move until the first truth at rest.

        Nothing here depends on when this process received them, as it may be late itself.
        """
        until(self.standing, what="standing")
        last = self.moving[-1].sense_seq
        truths = [truth for truth, _ in tuple(self.truths)]
        since_ns = max(truth.time_ns for truth in truths if truth.seq == last)
        still_ns = min(t.time_ns for t in truths if t.time_ns > since_ns and moved_not(t))
        return (still_ns - since_ns) / NS_PER_MS


def prefer(pid: int) -> None:
    """Let a session run before others, if this user may: other load is not under test."""
    with suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text("-10")


def real_time(pid: int) -> None:
    """Schedule all threads of a started process in real time, if this user may.

    While it still starts it must not be: its imports would delay the other robots.
    """
    with suppress(OSError):
        for thread in os.listdir(f"/proc/{pid}/task"):
            os.sched_setscheduler(int(thread), os.SCHED_RR, os.sched_param(1))


def departs(crew: Crew, witness: Witness, *words: str) -> Running:
    """Start a verb that drives the robot, and again whenever the robot was late before it moved.

    In lockstep it is never late.
    """
    crew.in_real_time()
    deadline_s = time.monotonic() + DEPARTS_S
    while time.monotonic() < deadline_s:
        told = len(witness.statuses)
        running = crew.dialling(*words)
        stopped = partial(witness.was_late, told)
        until(partial(sets_off_or_not, witness, running, stopped), what=partial(story, witness))
        if witness.fast():
            return running
        running.ends()
        was_late = stopped() or witness.status.vehicle_reason in LATE
        assert was_late or reason_text(Reason.NO_SENSES) in running.said, running.said
        crew.run("arm")
    raise AssertionError(f"late for {DEPARTS_S:g} s: {story(witness)}")


def sets_off_or_not(witness: Witness, running: Running, stopped: Callable[[], bool]) -> bool:
    """Return whether the robot drives, was stopped, or the verb has failed."""
    return witness.fast() or stopped() or running.process.poll() not in (None, 0)


def story(witness: Witness) -> str:
    return f"{witness.status}; {witness.texts}"


def moved_not(truth: GroundTruth) -> bool:
    return abs(truth.speed_m_s) < STILL_M_S and abs(truth.yaw_rate_rad_s) < 0.01


def open_patiently(network: Network, robot: str) -> Bus:
    found: list[Bus] = []

    def opened() -> bool:
        try:
            found.append(open_bus(network, Role.GROUND, robot))
        except NoPeerError:
            return False
        return True

    until(opened, what="somebody to listen")
    return found[0]


def alive(pid: int) -> bool:
    """Is it there and not merely waiting to be reaped?"""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


ROOT = Path(__file__).parents[3]


def children_of(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def cmdline(pid: int) -> str:
    """Return the words of a process; none if it has just ended."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return ""


def frames_in(folder: Path) -> int:
    (log,) = folder.glob("*.tlog")
    with log.open("rb") as source:
        reader = TlogReader(source)
        for record in reader:
            decode(record.frame)
    assert reader.lost_bytes < 300, "more than the record that was being written is lost"
    return reader.records
