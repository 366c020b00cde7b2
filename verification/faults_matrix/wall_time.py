"""One repetition in wall time: router, plant, robot, goto and recorder as real processes.

The robot and the others dial the router through cables that can be cut. The bus's own trouble, the
faults of the body, a hang with the interpreter's lock and a defect are made in the process itself,
on a signal. The plant listens, too, so that the truth is seen whatever becomes of the network.
"""

import resource
import signal
from collections.abc import Mapping
from contextlib import ExitStack
from random import Random
from time import monotonic_ns, time_ns
from typing import Final

from plant.world.file import SHIPPED_DIR, load
from protocol.topics import Role
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.goal import start_arguments
from runtime.units import NS_PER_S
from verification.faults_matrix.actions import (
    Abandon,
    Act,
    Burn,
    Cut,
    Double,
    EmergencyStop,
    Exaggerate,
    Fill,
    Flood,
    Hang,
    Impersonate,
    Kill,
    Slow,
    Spoil,
    Squeeze,
    Wrap,
)
from verification.faults_matrix.fault_commands import PATHS, afflictions_of
from verification.faults_matrix.impostor import NAME as IMPOSTOR
from verification.faults_matrix.impostor import Impostor
from verification.faults_matrix.intruders import Stranger
from verification.faults_matrix.log import Lost, lost_from
from verification.faults_matrix.observer import TUNED, Changes, Witness
from verification.faults_matrix.processes import Crew
from verification.faults_matrix.results import Repetition, reason_name
from verification.faults_matrix.table import Fault, Must, Way
from verification.flood.attack import Access, Attack
from verification.harness import motion
from verification.harness.motion import PERIOD_S
from verification.harness.processes import tls_of
from verification.harness.until import until

STOPPING: Final = (Must.STOP, Must.STAND, Must.SAY)
CORRIDOR, BOX = "corridor", "box"
PLACES: Final[Mapping[str, tuple[str, ...]]] = {CORRIDOR: ("5.5", "3"), BOX: ("3.0", "2.75")}
"""Where to: through the bends, or past the corner of the box."""
FAST_M_S: Final = 0.2
SET_OFF_S: Final = 1.5
HEALS_S: Final = 0.6
WATCHED_S: Final = 2.5
RUNS_OUT_S: Final = 0.5
LONGEST_S: Final = {True: 15.0, False: 300.0}
SAVED_S: Final = 20.0
"""Until the newest changes are on a slow disk."""
WRAPS_AFTER: Final = 2500
ATTEMPTS: Final = 3
ENDED: Final = (GoalState.REACHED, GoalState.STUCK, GoalState.ABORTED, GoalState.REFUSED)


class NotUnderWay(RuntimeError):
    """A busy machine kept the robot from driving, before anything was done to it."""


class Drill:
    """A crew under way, one fault, and what came of it."""

    def __init__(self, fault: Fault, number: int) -> None:
        self._fault, self._number = fault, number
        self._stops = fault.must in STOPPING
        self._random = Random(f"{fault.name} {number}")
        self._world = CORRIDOR if self._stops else BOX
        locked = isinstance(fault.act, Impersonate)
        self._crew = Crew(afflictions_of(fault.act, number), locked=locked)
        self._at_ns = self._healed_ns = 0
        self._killed_utc_ns: int | None = None
        self._stranger: Stranger | None = None
        self._impostor: Impostor | None = None
        self._changes: Changes | None = None
        self._said = 0

    def run(self) -> Repetition:
        with ExitStack() as scope:
            crew = scope.enter_context(self._crew)
            tls = None if crew.keys is None else tls_of(crew.keys, "ground")
            self._witness = Witness(crew.router, crew.truth, tls)
            try:
                self._begin(scope)
                scope.enter_context(self._witness)
                self._set_off()
            except RuntimeError as error:
                raise NotUnderWay(f"{error}; {self._crew.last_words('ground')}") from error
            self._at_ns = monotonic_ns()
            self._act(self._fault.act)
            until(self._over, "an end", 2.0 * LONGEST_S[self._stops])
            if self._changes is not None:
                until(self._changes.are_saved, "what was changed, saved", SAVED_S)
            self._check_told()
            lost = self._logged()
            return self._found(lost)

    def _begin(self, scope: ExitStack) -> None:
        crew, start = self._crew, load(self._world).start
        crew.start("router", "router", "--listen", crew.router)
        crew.says("router", "router at")
        place = start_arguments(start.x_m, start.y_m, start.heading_rad)
        state = ("--state", str(crew.folder / "state"))
        crew.dialling("robot", "robot", "--start", *place, *state)
        plant = (
            "plant",
            "--world",
            self._file(),
            "--noise",
            "default",
            "--seed",
            str(self._number),
        )
        listens = () if crew.truth == crew.router else ("--listen", crew.truth)
        crew.dialling("plant", *plant, *listens)
        crew.start("recorder", "record", str(crew.folder / "log"), "--connect", crew.router)
        for role, words in (("robot", "ready"), ("plant", "plant: "), ("recorder", "recording")):
            crew.says(role, words)
        match self._fault.act:
            case Abandon():
                crew.send("robot", signal.SIGUSR1)
            case Impersonate():
                assert crew.keys is not None
                self._impostor = scope.enter_context(Impostor(crew.keys))
            case Flood(kind):
                self._attack = scope.enter_context(Attack(kind, Access(crew.router)))

    def _file(self) -> str:
        """The world, or a copy of it with encoders that are about to wrap."""
        if not isinstance(self._fault.act, Wrap):
            return self._world
        text = (SHIPPED_DIR / f"{self._world}.toml").read_text(encoding="utf-8")
        ticks = 2**31 - WRAPS_AFTER
        path = self._crew.folder / f"{self._world}.toml"
        wrapping = f"\n[robot]\nleft_start_ticks = {ticks}\nright_start_ticks = {ticks}\n"
        path.write_text(text + wrapping, encoding="utf-8")
        return str(path)

    def _set_off(self) -> None:
        witness, waits = self._witness, not isinstance(self._fault.act, Fill | Slow)
        until(lambda: witness.is_in(Vehicle.STANDBY) and witness.truths, "a robot in STANDBY")
        if self._fault.at_rest:
            return
        if self._fault.act == Double():
            self._second = witness.join(Role.ROBOT)
        goto = ("goto", *PLACES[self._world], *(() if waits else ("--no-wait",)))
        self._crew.dialling("ground", *goto)
        until(lambda: witness.speed_m_s > FAST_M_S, "driving")
        moment_ns = monotonic_ns() + round(self._random.uniform(0.0, SET_OFF_S) * NS_PER_S)
        until(lambda: monotonic_ns() >= moment_ns, "the moment")
        if not witness.is_in(Vehicle.ACTIVE):
            raise RuntimeError("it stopped before anything was done to it")

    def _act(self, act: Act) -> None:
        crew = self._crew
        match act:
            case Kill(role):
                self._killed_utc_ns = time_ns()
                crew.kill(role)
            case Hang(role, gil=False):
                crew.send(role, signal.SIGSTOP)
            case Cut(one, other) if "router" in (one, other):
                crew.cables[one if other == "router" else other].cut()
            case Impersonate():
                assert self._impostor is not None
                crew.cables["robot"].redirect(self._impostor.endpoint)
            case EmergencyStop():
                self._witness.estop()
            case Abandon():
                crew.kill("ground")
            case Flood(pressed=pressed):
                self._attack.go()
                if pressed:
                    self._witness.press()
            case Slow():
                crew.send("robot", signal.SIGUSR1)
                self._changes = Changes(self._witness, crew.folder / "state")
            case Wrap():
                """They wrap by themselves."""
            case Double() | Exaggerate() | Spoil() | Fill() | Squeeze() | Burn():
                self._impair(act)
            case _:
                for role in afflictions_of(act, 0):
                    crew.send(role, signal.SIGUSR1)

    def _impair(self, act: Act) -> None:
        """Spoil what a process needs, or let another one get in its way."""
        crew = self._crew
        match act:
            case Spoil():
                crew.kill("robot")
                (crew.folder / "state" / "fence.json").write_text("[{", encoding="utf-8")
            case Double():
                self._second.announce()
            case Exaggerate():
                self._stranger = Stranger(self._witness.join(Role.GROUND))
            case Fill(role):
                crew.limit(role, resource.RLIMIT_FSIZE, 1)
                self._witness.set(TUNED, 0.31)
            case Squeeze():
                crew.limit("robot", resource.RLIMIT_AS, crew.memory("robot"))
            case Burn():
                crew.burn()

    def _heal(self, act: Act) -> None:
        """The end of the fault, where it has one; who hangs for good is ended and started anew."""
        crew = self._crew
        match act:
            case Kill("recorder"):
                """Its log is looked at as it was left."""
            case Hang(role, gil=False):
                crew.send(role, signal.SIGCONT)
            case Impersonate():
                crew.cables["robot"].redirect(crew.router)
            case Flood():
                self._attack.hold()
            case Spoil():
                crew.start("robot")
                until(self._witness.is_refused_arming, "an answer to arming")
            case Kill(role) | Hang(role):
                crew.kill(role)
                crew.start(role)
            case Cut(one, other) if "router" in (one, other):
                crew.cables[one if other == "router" else other].restore()
            case _:
                """It stays as it is."""

    def _over(self) -> bool:
        now_s = self._since(monotonic_ns())
        self._heal_in_time(now_s)
        self._exaggerate(now_s)
        if self._changes is not None:
            self._changes.make(now_s)
        if self._impostor is not None:
            self._impostor.lie()
        if now_s > LONGEST_S[self._stops]:
            return True
        if self._stops:
            return bool(self._healed_ns) and now_s > self._since(self._healed_ns) + WATCHED_S
        status = self._witness.status
        return status is not None and status.goal in ENDED and now_s > WATCHED_S

    def _exaggerate(self, now_s: float) -> None:
        """Other frames each period, all the time. RuntimeError when that has ended a process."""
        if self._stranger is None:
            return
        if now_s < self._said * PERIOD_S:
            self._stranger.repeat(lambda _, put: put())
            return
        self._said += 1
        self._stranger.take_turn(lambda _, put: put())
        if not all(map(self._crew.lives, ("router", "robot", "plant"))):
            raise RuntimeError(f"a process ended: {self._crew.last_words('robot')}")

    def _heal_in_time(self, now_s: float) -> None:
        if self._healed_ns:
            return
        again_s = getattr(self._fault.act, "again_s", None)
        if again_s is None and self._stops:
            stands_s = self._known_s() if self._fault.must is Must.SAY else self._stood_s()
            again_s = None if stands_s is None else stands_s + HEALS_S
        if again_s is not None and now_s > again_s:
            self._healed_ns = monotonic_ns()
            self._heal(self._fault.act)

    def _since(self, at_ns: int) -> float:
        return (at_ns - self._at_ns) / NS_PER_S

    def _known_s(self) -> float | None:
        known_ns = self._witness.known_ns(self._at_ns)
        return None if known_ns is None else self._since(known_ns)

    def _stood_s(self) -> float | None:
        return motion.stood_s(self._witness.seen(self._at_ns))

    def _check_told(self) -> None:
        """Raise RuntimeError when the robot has not told of the impostor that it met."""
        met = isinstance(self._fault.act, Impersonate)
        if met and IMPOSTOR not in self._crew.said("robot"):
            raise RuntimeError(f"it met no impostor: {self._crew.last_words('robot')}")

    def _logged(self) -> Lost | None:
        """What the log lacks, when the recorder has ended as it should."""
        crew = self._crew
        if crew.lives("recorder"):
            crew.send("recorder", signal.SIGINT)
            crew.ends("recorder")
        act = self._fault.act
        role = act.role if isinstance(act, Kill | Hang) else "robot" if act == Spoil() else ""
        again = PATHS.get(role, ())
        logs = sorted((crew.folder / "log").glob("*.tlog"))
        return lost_from(logs[0], again) if logs else None

    def _found(self, lost: Lost | None) -> Repetition:
        seen, status = self._witness.seen(self._at_ns), self._witness.status
        visible = self._fault.must is not Must.SAY
        killed_ns = self._killed_utc_ns if self._fault.act == Kill("recorder") else None
        return Repetition(
            fault=self._fault.name,
            way=Way.WALL.value,
            number=self._number,
            known_s=self._known_s(),
            stood_s=motion.stood_s(seen) if visible else None,
            distance_m=motion.distance_m(seen) if self._stops and visible else None,
            reason=self._reason(),
            reached=status is not None and status.goal == GoalState.REACHED,
            contacts=motion.contacts(seen),
            touched_s=motion.touched_s(seen),
            moved_again=motion.moved_again(seen) if visible else self._drove_on(),
            logged=lost.logged if lost else None,
            lost=lost.samples if lost else None,
            lost_events=lost.events if lost else None,
            unlogged_s=(killed_ns - lost.last_ns) / NS_PER_S if lost and killed_ns else None,
            missed_ticks=self._witness.missed_ticks(self._at_ns) if self._changes else None,
        )

    def _reason(self) -> str:
        """Why it does not drive; of a robot that began anew, what it said before."""
        told = [one.message for one in tuple(self._witness.statuses) if one.at_ns >= self._at_ns]
        stopped = [one.vehicle_reason for one in told if one.vehicle != Vehicle.ACTIVE]
        return reason_name(next(filter(None, stopped), told[-1].goal_reason if told else 0))

    def _drove_on(self) -> bool:
        """Of a plant that was gone: does the robot move when it is back?"""
        back_ns = self._healed_ns + round(RUNS_OUT_S * NS_PER_S)
        later = [one for one in tuple(self._witness.truths) if one.at_ns > back_ns]
        return any(not motion.Seen(0.0, one.message).still for one in later)


def run(fault: Fault, number: int) -> Repetition:
    """A repetition that breaks down is told, not lost; one that never began is begun again."""
    why = ""
    for _ in range(ATTEMPTS):
        try:
            return Drill(fault, number).run()
        except NotUnderWay as error:
            why = str(error)
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
            break
    return Repetition(fault=fault.name, way=Way.WALL.value, number=number, trouble=why[:200])
