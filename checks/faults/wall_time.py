"""Run one repetition in wall time: router, plant, robot, goto and recorder as real processes.

The processes are started and ended by role. They connect to the router through TCP proxies that can
be cut. Network disturbances, faults of the body, a hang with the GIL held and an exception are
caused in the process itself, on a signal (`fault_hook`). The plant listens too, so that the truth
is received even when the network is cut. The sequence numbers of each key show the frames that the
recorder's log lacks.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from random import Random
from time import monotonic_ns, time_ns
from typing import Any, Final, NamedTuple, Self

from checks.faults.bus_observer import (
    IMPOSTOR,
    TUNED,
    BusObserver,
    Changes,
    ExtremeSender,
    Impostor,
)
from checks.faults.cases import (
    RUNS_OUT_S,
    Act,
    BodyFault,
    Cut,
    DelayOperator,
    Disturb,
    DropOneWay,
    FaultCase,
    FillDisk,
    Flood,
    Hang,
    JumpClock,
    Kill,
    KillLateOperator,
    Must,
    PlainAct,
    Repetition,
    SlowDisk,
    Way,
    reason_name,
)
from checks.flood.attackers import Access, Attack
from checks.harness.observer import (
    contacts,
    distance_m,
    is_still,
    moved_again,
    stood_s,
    touched_s,
)
from checks.harness.processes import Running, free_port, made_keys, tls_of
from checks.harness.relays import TcpProxy
from checks.harness.until import PATIENCE_S, until
from ground.launch.child_command import command
from ground.recording.log_reader import open_log
from ground.station.link.streams import SEQUENCE_AT
from plant.world.file import SHIPPED_DIR, load
from protocol.outcome import start_arguments
from protocol.topics import TOPICS, Role, path_of
from protocol.wire.enums import GoalState, Vehicle
from runtime.cli.verb_table import with_present_name
from runtime.config import totals_arguments
from runtime.units import NS_PER_S, PERIOD_S

LAST_OUTPUT: Final = 300
CERTIFICATES: Final = {"robot": "robot-r1"}
BURNS: Final = (sys.executable, "-c", "while True: pass")


class ProcessGroup:
    """The processes of a stack.

    `injections` are the faults that a role injects into itself on SIGUSR1. With `locked`, access is
    controlled, and `keys` is the folder of the certificates; else `keys` is None.
    """

    def __init__(
        self, injections: Mapping[str, Mapping[str, Any]], *, locked: bool = False
    ) -> None:
        self.router = f"{'tls' if locked else 'tcp'}/127.0.0.1:{free_port()}"
        self.truth = self.router if locked else f"tcp/127.0.0.1:{free_port()}"
        """Endpoint of the truth: the plant, or the router if access control forbids that."""
        self.keys: Path | None = None
        self._locked = locked
        self.proxies: dict[str, TcpProxy] = {}
        self._injections = injections
        self._words: dict[str, Sequence[str]] = {}
        self._processes: dict[str, Running] = {}
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        self.folder = Path(self._scope.enter_context(tempfile.TemporaryDirectory()))
        if self._locked:
            self.keys = made_keys(self.folder / "keys")
        return self

    def __exit__(self, *_: object) -> None:
        for role in self._processes:
            self.kill(role)
        self._scope.close()

    def start(self, role: str, *words: str) -> None:
        """Run `sidestep` with these words, or with those of the last start."""
        if words:
            self._words[role] = [*words, *self._config(role)]
        injection = self._injections.get(role)
        line = command(self._words[role], os.getpid())
        if injection is not None:
            module = (sys.executable, "-m", "checks.faults.fault_hook")
            present = with_present_name(self._words[role])
            line = [*module, str(os.getpid()), json.dumps(injection), *present]
        self._execute(role, line)

    def _config(self, role: str) -> Sequence[str]:
        if self.keys is None:
            return ()
        return "--config", str(self.keys / f"{CERTIFICATES.get(role, role)}.toml")

    def burn(self) -> None:
        """Start one process per core that only uses the processor."""
        for number in range(len(os.sched_getaffinity(0))):
            self._execute(f"burner {number}", BURNS)

    def start_behind_proxy(self, role: str, *words: str) -> None:
        """Start a process that connects to the router through a proxy."""
        proxy = self.proxies[role] = self._scope.enter_context(TcpProxy(self.router))
        self.start(role, *words, "--connect", proxy.endpoint)

    def await_output(self, role: str, words: str) -> None:
        """Wait until a process has written `words`; RuntimeError when it ends before."""
        self._processes[role].says(words)

    def output(self, role: str) -> str:
        """Return the output of a process."""
        return self._processes[role].said

    def last_output(self, role: str) -> str:
        """Return the end of the output; empty if the process was never started."""
        return self.output(role)[-LAST_OUTPUT:] if role in self._processes else ""

    def is_running(self, role: str) -> bool:
        """Return whether a process is running."""
        return role in self._processes and self._processes[role].process.poll() is None

    def send(self, role: str, number: signal.Signals) -> None:
        """Send a signal."""
        self._processes[role].send(number)

    def limit(self, role: str, what: int, size: int) -> None:
        """Limit a resource of a process to `size` from now on."""
        resource.prlimit(self._processes[role].pid, what, (size, size))

    def memory(self, role: str) -> int:
        """Return the size of the address space in bytes."""
        pages = Path(f"/proc/{self._processes[role].pid}/statm").read_text(encoding="utf-8")
        return int(pages.split()[0]) * resource.getpagesize()

    def kill(self, role: str) -> None:
        """Kill a process and wait for its end."""
        self._processes[role].process.kill()
        self._processes[role].process.wait()

    def await_end(self, role: str) -> None:
        """Wait for the end of a process; kill it if it takes too long."""
        try:
            self._processes[role].process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.kill(role)

    def _execute(self, role: str, line: Sequence[str]) -> None:
        running = self._processes[role] = Running(line)
        self._scope.callback(running.close)


PATHS: Final[Mapping[str, tuple[str, ...]]] = {
    "robot": ("tlm/", "drive/"),
    "plant": ("sense/", "truth/"),
    "ground": ("op/",),
}
"""The topics that each process publishes."""
ENDS: Final = ("robot", "plant")


def injections_of(act: Act, seed: int) -> dict[str, Mapping[str, Any]]:
    """Return the injections that an act needs, by role."""
    match act:
        case Hang(role, gil=True):
            return {role: {"hang": {}}}
        case PlainAct.RAISE_IN_CORE:
            return {"robot": {"raise": {}}}
        case JumpClock(seconds):
            return {"robot": {"jump": {"s": seconds}}}
        case Disturb(trouble):
            return {role: {"trouble": asdict(trouble) | {"seed": seed}} for role in ENDS}
        case DropOneWay(receiver, sender):
            return {receiver: {"trouble": {"loss": 1.0, "paths": PATHS[sender]}}}
        case DelayOperator(delay_ms) | KillLateOperator(delay_ms):
            return {"robot": {"trouble": {"delay_ms": delay_ms, "paths": PATHS["ground"]}}}
        case SlowDisk(fsync_s):
            return {"robot": {"fsync": {"s": fsync_s}}}
        case BodyFault():
            return {"plant": {"sense": asdict(act)}}
        case Cut(one, other) if "router" not in (one, other):
            links = [link for link in ((one, other), (other, one)) if link[0] != "ground"]
            return {to: {"trouble": {"loss": 1.0, "paths": PATHS[source]}} for to, source in links}
        case _:
            return {}


TURN: Final = 256
EVENTS: Final = frozenset(topic.path for topic in TOPICS if not topic.rate_hz)


class Lost(NamedTuple):
    """Numbers of logged frames and of missing samples and events, and the last frame's UTC time."""

    logged: int
    samples: int
    events: int
    last_ns: int


def lost_from(path: Path, restarted: tuple[str, ...] = ()) -> Lost:
    """Count what a log lacks, except for keys that begin with one of `restarted`.

    The senders of those keys began a new count, so their losses cannot be counted.
    """
    sequences: dict[str, list[int]] = {}
    last_ns = count = 0
    for frame in open_log(path):
        count += 1
        last_ns = max(last_ns, frame.time_ns)
        topic = path_of(frame.key)
        if not topic.startswith(restarted):
            sequences.setdefault(topic, []).append(frame.frame[SEQUENCE_AT])
    gaps = {topic: missing(numbers) for topic, numbers in sequences.items()}
    events = sum(gap for topic, gap in gaps.items() if topic in EVENTS)
    return Lost(count, sum(gaps.values()) - events, events, last_ns)


def missing(numbers: Iterable[int]) -> int:
    """Count the gaps in numbers that wrap after 255 and may be out of order."""
    newest: int | None = None
    there = set()
    for number in numbers:
        if newest is None:
            newest = number
        ahead = (number - newest + TURN // 2) % TURN - TURN // 2
        there.add(newest + ahead)
        newest = max(newest, newest + ahead)
    return max(there) - min(there) + 1 - len(there) if there else 0


CORRIDOR, BOX = "corridor", "box"
PLACES: Final[Mapping[str, tuple[str, ...]]] = {CORRIDOR: ("5.5", "3"), BOX: ("3.0", "2.75")}
"""Destinations: through the bends, or past the corner of the box."""
FAST_M_S: Final = 0.2
SET_OFF_S: Final = 1.5
HEALS_S: Final = 0.6
WATCHED_S: Final = 2.5
LONGEST_S: Final = {True: 15.0, False: 300.0}
SAVED_S: Final = 20.0
"""Time until the newest changes are saved on a slow disk."""
WRAPPING: Final = dict.fromkeys(("left_start_ticks", "right_start_ticks"), 2**31 - 2500)
"""Encoders that are about to wrap."""
ATTEMPTS: Final = 3
ENDED: Final = (GoalState.REACHED, GoalState.STUCK, GoalState.ABORTED, GoalState.REFUSED)


class NotDrivingError(RuntimeError):
    """A busy machine kept the robot from driving before the fault."""


class WallTimeDrill:
    """A driving robot as real processes, one fault, and the observed reaction."""

    def __init__(self, fault: FaultCase, number: int) -> None:
        self._fault, self._number = fault, number
        self._stops = fault.must_stop
        self._random = Random(f"{fault.name} {number}")
        self._world = CORRIDOR if self._stops else BOX
        locked = fault.act is PlainAct.IMPERSONATE_ROUTER
        self._processes = ProcessGroup(injections_of(fault.act, number), locked=locked)
        self._at_ns = self._healed_ns = 0
        self._killed_utc_ns: int | None = None
        self._sender: ExtremeSender | None = None
        self._impostor: Impostor | None = None
        self._changes: Changes | None = None
        self._turns_sent = 0

    def run(self) -> Repetition:
        """Drive, cause the fault and return the reaction."""
        with ExitStack() as scope:
            processes = scope.enter_context(self._processes)
            tls = None if processes.keys is None else tls_of(processes.keys, "ground")
            self._observer = BusObserver(processes.router, processes.truth, tls)
            try:
                self._begin(scope)
                scope.enter_context(self._observer)
                self._set_off()
            except RuntimeError as error:
                raise NotDrivingError(
                    f"{error}; {self._processes.last_output('ground')}"
                ) from error
            self._at_ns = monotonic_ns()
            self._act(self._fault.act)
            until(self._over, "the end of the observation", 2.0 * LONGEST_S[self._stops])
            if self._changes is not None:
                until(self._changes.are_saved, "all changes saved", SAVED_S)
            self._check_impostor()
            lost = self._logged()
            return self._found(lost)

    def _begin(self, scope: ExitStack) -> None:
        processes, start = self._processes, load(self._world).start
        processes.start("router", "router", "--listen", processes.router)
        processes.await_output("router", "router at")
        place = [*start_arguments(start.x_m, start.y_m, start.heading_rad)]
        if self._fault.act is PlainAct.WRAP_ENCODERS:
            place += totals_arguments(WRAPPING)
        state = ("--state", str(processes.folder / "state"))
        processes.start_behind_proxy("robot", "robot", "--start", *place, *state)
        options = ("--noise", "default", "--seed", str(self._number))
        listens = () if processes.truth == processes.router else ("--listen", processes.truth)
        plant = ("plant", "--world", self._file(), *options)
        processes.start_behind_proxy("plant", *plant, *listens)
        processes.start(
            "recorder", "record", str(processes.folder / "log"), "--connect", processes.router
        )
        for role, words in (("robot", "ready"), ("plant", "plant: "), ("recorder", "recording")):
            processes.await_output(role, words)
        match self._fault.act:
            case KillLateOperator():
                processes.send("robot", signal.SIGUSR1)
            case PlainAct.IMPERSONATE_ROUTER:
                assert processes.keys is not None
                self._impostor = scope.enter_context(Impostor(processes.keys))
            case Flood(kind):
                self._attack = scope.enter_context(Attack(kind, Access(processes.router)))

    def _file(self) -> str:
        """Return the name of the world, or a copy of it with encoders that are about to wrap."""
        if self._fault.act is not PlainAct.WRAP_ENCODERS:
            return self._world
        text = (SHIPPED_DIR / f"{self._world}.toml").read_text(encoding="utf-8")
        path = self._processes.folder / f"{self._world}.toml"
        wrapping = "".join(f"{name} = {ticks}\n" for name, ticks in WRAPPING.items())
        path.write_text(f"{text}\n[robot]\n{wrapping}", encoding="utf-8")
        return str(path)

    def _set_off(self) -> None:
        observer, waits = self._observer, not isinstance(self._fault.act, FillDisk | SlowDisk)
        until(lambda: observer.is_in(Vehicle.STANDBY) and observer.truths, "a robot in STANDBY")
        if self._fault.at_rest:
            return
        if self._fault.act is PlainAct.SECOND_ROBOT:
            self._second = observer.join(Role.ROBOT)
        goto = ("goto", *PLACES[self._world], *(() if waits else ("--no-wait",)))
        self._processes.start_behind_proxy("ground", *goto)
        until(lambda: observer.speed_m_s > FAST_M_S, "driving")
        moment_ns = monotonic_ns() + round(self._random.uniform(0.0, SET_OFF_S) * NS_PER_S)
        until(lambda: monotonic_ns() >= moment_ns, "the time of the fault")
        if not observer.is_in(Vehicle.ACTIVE):
            raise RuntimeError("the robot stopped before the fault")

    def _act(self, act: Act) -> None:
        processes = self._processes
        match act:
            case Kill(role):
                self._killed_utc_ns = time_ns()
                processes.kill(role)
            case Hang(role, gil=False):
                processes.send(role, signal.SIGSTOP)
            case Cut(one, other) if "router" in (one, other):
                processes.proxies[one if other == "router" else other].cut()
            case PlainAct.IMPERSONATE_ROUTER:
                assert self._impostor is not None
                processes.proxies["robot"].redirect(self._impostor.endpoint)
            case PlainAct.EMERGENCY_STOP:
                self._observer.estop()
            case KillLateOperator():
                processes.kill("ground")
            case Flood(pressed=pressed):
                self._attack.go()
                if pressed:
                    self._observer.press()
            case SlowDisk():
                processes.send("robot", signal.SIGUSR1)
                self._changes = Changes(self._observer, processes.folder / "state")
            case PlainAct.WRAP_ENCODERS:
                """The world starts with counters that are about to wrap."""
            case _:
                self._impair(act)

    def _impair(self, act: Act) -> None:
        """Take a resource from a process, let another process interfere, or signal an injection."""
        processes = self._processes
        match act:
            case PlainAct.UNREADABLE_FENCE:
                processes.kill("robot")
                (processes.folder / "state" / "fence.json").write_text("[{", encoding="utf-8")
            case PlainAct.SECOND_ROBOT:
                self._second.announce()
            case PlainAct.EXTREME_FRAMES:
                self._sender = ExtremeSender(self._observer.join(Role.GROUND))
            case FillDisk(role):
                processes.limit(role, resource.RLIMIT_FSIZE, 1)
                self._observer.set(TUNED, 0.31)
            case PlainAct.NO_MEMORY:
                processes.limit("robot", resource.RLIMIT_AS, processes.memory("robot"))
            case PlainAct.BUSY_PROCESSOR:
                processes.burn()
            case _:
                for role in injections_of(act, 0):
                    processes.send(role, signal.SIGUSR1)

    def _heal(self, act: Act) -> None:
        """End the fault, if it has an end; restart a process that hangs for good."""
        processes = self._processes
        match act:
            case Kill("recorder"):
                """The log stays as the recorder left it."""
            case Hang(role, gil=False):
                processes.send(role, signal.SIGCONT)
            case PlainAct.IMPERSONATE_ROUTER:
                processes.proxies["robot"].redirect(processes.router)
            case Flood():
                self._attack.hold()
            case PlainAct.UNREADABLE_FENCE:
                processes.start("robot")
                until(self._observer.is_refused_arming, "an answer to arming")
            case Kill(role) | Hang(role):
                processes.kill(role)
                processes.start(role)
            case Cut(one, other) if "router" in (one, other):
                processes.proxies[one if other == "router" else other].restore()
            case _:
                """This fault does not end."""

    def _over(self) -> bool:
        now_s = self._since(monotonic_ns())
        self._heal_in_time(now_s)
        self._send_extremes(now_s)
        if self._changes is not None:
            self._changes.make(now_s)
        if self._impostor is not None:
            self._impostor.send()
        if now_s > LONGEST_S[self._stops]:
            return True
        if self._stops:
            return bool(self._healed_ns) and now_s > self._since(self._healed_ns) + WATCHED_S
        return self._observer.status.goal in ENDED and now_s > WATCHED_S

    def _send_extremes(self, now_s: float) -> None:
        """Send new extreme frames each period; RuntimeError when that has ended a process."""
        if self._sender is None:
            return
        if now_s < self._turns_sent * PERIOD_S:
            self._sender.repeat(lambda _, put: put())
            return
        self._turns_sent += 1
        self._sender.take_turn(lambda _, put: put())
        if not all(map(self._processes.is_running, ("router", "robot", "plant"))):
            raise RuntimeError(f"a process ended: {self._processes.last_output('robot')}")

    def _heal_in_time(self, now_s: float) -> None:
        if self._healed_ns:
            return
        again_s = getattr(self._fault.act, "again_s", None)
        if again_s is None and self._stops:
            stands_s = (
                self._known_s()
                if self._fault.must is Must.SAY
                else stood_s(self._observer.seen(self._at_ns))
            )
            again_s = None if stands_s is None else stands_s + HEALS_S
        if again_s is not None and now_s > again_s:
            self._healed_ns = monotonic_ns()
            self._heal(self._fault.act)

    def _since(self, at_ns: int) -> float:
        return (at_ns - self._at_ns) / NS_PER_S

    def _known_s(self) -> float | None:
        known_ns = self._observer.known_ns(self._at_ns)
        return None if known_ns is None else self._since(known_ns)

    def _check_impostor(self) -> None:
        """Raise RuntimeError when the robot has not reported the impostor."""
        expected = self._fault.act is PlainAct.IMPERSONATE_ROUTER
        if expected and IMPOSTOR not in self._processes.output("robot"):
            end = self._processes.last_output("robot")
            raise RuntimeError(f"the robot reported no impostor: {end}")

    def _logged(self) -> Lost | None:
        """End the recorder and return what its log lacks; None without a log."""
        processes = self._processes
        if processes.is_running("recorder"):
            processes.send("recorder", signal.SIGINT)
            processes.await_end("recorder")
        act = self._fault.act
        role = (
            act.role
            if isinstance(act, Kill | Hang)
            else "robot"
            if act is PlainAct.UNREADABLE_FENCE
            else ""
        )
        again = PATHS.get(role, ())
        logs = sorted((processes.folder / "log").glob("*.tlog"))
        return lost_from(logs[0], again) if logs else None

    def _found(self, lost: Lost | None) -> Repetition:
        seen, status = self._observer.seen(self._at_ns), self._observer.status
        visible = self._fault.must is not Must.SAY
        killed_ns = self._killed_utc_ns if self._fault.act == Kill("recorder") else None
        return Repetition(
            fault=self._fault.name,
            way=Way.WALL.value,
            number=self._number,
            known_s=self._known_s(),
            stood_s=stood_s(seen) if visible else None,
            distance_m=distance_m(seen) if self._stops and visible else None,
            reason=self._reason(),
            reached=status.goal == GoalState.REACHED,
            contacts=contacts(seen),
            touched_s=touched_s(seen),
            moved_again=moved_again(seen) if visible else self._drove_on(),
            logged=lost.logged if lost else None,
            lost=lost.samples if lost else None,
            lost_events=lost.events if lost else None,
            unlogged_s=(killed_ns - lost.last_ns) / NS_PER_S if lost and killed_ns else None,
            missed_ticks=self._observer.missed_ticks(self._at_ns) if self._changes else None,
        )

    def _reason(self) -> str:
        """Return why the robot does not drive; for a restarted robot, the reason before that."""
        later = [one for one, at_ns in tuple(self._observer.statuses) if at_ns >= self._at_ns]
        stopped = [one.vehicle_reason for one in later if one.vehicle != Vehicle.ACTIVE]
        return reason_name(next(filter(None, stopped), later[-1].goal_reason if later else 0))

    def _drove_on(self) -> bool:
        """Return whether the robot moves after the plant is back."""
        back_ns = self._healed_ns + round(RUNS_OUT_S * NS_PER_S)
        later = [one for one, at_ns in tuple(self._observer.truths) if at_ns > back_ns]
        return any(not is_still(one) for one in later)


def run(fault: FaultCase, number: int) -> Repetition:
    """Run a repetition; repeat it if the robot never drove. A failure becomes `trouble`."""
    why = ""
    for _ in range(ATTEMPTS):
        try:
            return WallTimeDrill(fault, number).run()
        except NotDrivingError as error:
            why = str(error)
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
            break
    return Repetition(fault=fault.name, way=Way.WALL.value, number=number, trouble=why[:200])
