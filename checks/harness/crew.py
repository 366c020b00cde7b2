"""Verbs of `sidestep` as processes at one endpoint, a witness of their bus, and their table."""

import os
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Final, Self

from checks.harness.observer import BusWitness, is_still
from checks.harness.processes import ROBOT, Running, free_port
from checks.harness.until import until
from ground.launch.child_command import command
from ground.recording.log_reader import TlogReader
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from protocol.wire.codec import decode
from protocol.wire.enums import Vehicle
from protocol.wire.messages import (
    CycleReport,
    GroundTruth,
)
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import NoPeerError
from runtime.units import NS_PER_MS

FAST_M_S: Final = 0.25
DEPARTS_S: Final = 60.0
TRIES: Final = 3
BUSY_HUB: Final = "does not answer (waited"
LATE: Final = (Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.BUDGET)
"""Reasons for a stop that a busy machine can cause."""
LOCAL: Final = "127.0.0.1"


def free_endpoint() -> str:
    """Return a loopback endpoint that no process uses at the moment."""
    return f"tcp/{LOCAL}:{free_port()}"


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
        running = Running(words, terminal=terminal)
        self._scope.callback(running.close)
        prefer(running.pid)
        self._started.append(running)
        return running

    def start(self, *words: str) -> Running:
        """`sidestep` with these words."""
        return self.execute(*command(words, os.getpid()))

    def listening(self, *words: str) -> Running:
        """Start a verb that listens at the endpoint."""
        return self.start(*words, "--listen", self.endpoint)

    def dialling(self, *words: str) -> Running:
        """Start a verb that connects to the endpoint."""
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


class Witness(BusWitness):
    """Sees what arrives from an endpoint, until the block ends.

    What cannot be read is a mistake of the stack, unless it is not `strict`.
    """

    def __init__(self, endpoint: str, robot: str = ROBOT, *, strict: bool = True) -> None:
        super().__init__(robot, kept=20_000)
        self._network = Network(mode="client", connect=(endpoint,), connect_timeout_s=0.5)
        self._strict = strict

    def __enter__(self) -> Self:
        self.listen(open_patiently(self._network, self.robot))
        return self

    def __exit__(self, *_: object) -> None:
        self.bus.close()
        assert not (self._strict and self.unreadable)

    @property
    def report(self) -> CycleReport | None:
        """The newest cycle report."""
        return self.cycles[-1][0] if self.cycles else None

    @property
    def speeds(self) -> tuple[int, int] | None:
        """The newest wheel command, in mrad/s."""
        newest = self.wheels[-1][0] if self.wheels else None
        return None if newest is None else (newest.left_mrad_s, newest.right_mrad_s)

    @property
    def truth(self) -> GroundTruth:
        """The newest true state; waits for the first."""
        until(lambda: self.truths, "the truth")
        return self.truths[-1][0]

    def ready(self) -> None:
        """Wait until the robot is ready."""
        until(lambda: self.status.vehicle == Vehicle.STANDBY, "STANDBY")

    def fast(self) -> bool:
        """Return whether the robot drives fast."""
        return self.truth.speed_m_s > FAST_M_S

    def was_late(self, since: int) -> bool:
        """Return whether a later status shows a stop that a busy machine can cause."""
        return any(
            status.vehicle == Vehicle.FAILSAFE and status.vehicle_reason in LATE
            for status, _ in tuple(self.statuses)[since:]
        )

    def driving(self) -> None:
        """Wait until the robot drives fast."""
        try:
            until(self.fast, "driving")
        except RuntimeError as error:
            raise RuntimeError(f"{error}; {self.status}; {self.texts}") from None

    def standing(self) -> bool:
        """Return whether the robot is truly at rest."""
        return is_still(self.truth)

    def rolled_on_ms(self) -> float:
        """Simulated time from the tick of the last command to move until the first truth at rest.

        Nothing here depends on when this process received them, as it may be late itself.
        """
        until(self.standing, "standing")
        moving = [one for one, _ in tuple(self.wheels) if one.left_mrad_s or one.right_mrad_s]
        last = moving[-1].sense_seq
        truths = [truth for truth, _ in tuple(self.truths)]
        since_ns = max(truth.time_ns for truth in truths if truth.seq == last)
        still_ns = min(t.time_ns for t in truths if t.time_ns > since_ns and is_still(t))
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
        until(partial(sets_off_or_not, witness, running, stopped), partial(story, witness))
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
    """Return status and texts, for error messages."""
    return f"{witness.status}; {witness.texts}"


def open_patiently(network: Network, robot: str) -> Bus:
    """Open a bus as soon as somebody listens."""
    found: list[Bus] = []

    def opened() -> bool:
        try:
            found.append(open_bus(network, Role.GROUND, robot))
        except NoPeerError:
            return False
        return True

    until(opened, "somebody to listen")
    return found[0]


def alive(pid: int) -> bool:
    """Return whether it is there, and does not merely wait to be reaped."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


ROOT: Final = Path(__file__).parents[2]


def children_of(pid: int) -> list[int]:
    """Return the ids of the children of a process."""
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def cmdline(pid: int) -> str:
    """Return the words of a process; none if it has just ended."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return ""


def frames_in(folder: Path) -> int:
    """Return how many frames the only log of a folder has; each must be readable."""
    (log,) = folder.glob("*.tlog")
    with log.open("rb") as source:
        reader = TlogReader(source)
        for record in reader:
            decode(record.frame)
    assert reader.lost_bytes < 300, "more than the record that was being written is lost"
    return reader.records
