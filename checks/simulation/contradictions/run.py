"""Run a scenario of persons and their programs, and compare what they said with what was."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import blake2b
from random import Random
from types import SimpleNamespace
from typing import Any, Final
from unittest.mock import patch

import zenoh

from checks.simulation.contradictions.claims import Recorded, contradictions
from checks.simulation.contradictions.defects import DEFECTS
from checks.simulation.contradictions.journal import Journal, Shown
from checks.simulation.contradictions.mavlink_station import MavlinkStation
from checks.simulation.contradictions.programs import (
    App,
    Notebook,
    Program,
    Shell,
    Up,
    common_here,
    open_bus_here,
)
from checks.simulation.contradictions.truth import ListeningNetwork, Truth, person_of
from checks.simulation.coverage import Coverage
from checks.simulation.events import Event, EventScenario
from checks.simulation.hosts import robot_side
from checks.simulation.hosts.event_loop import SimulatedExecutor
from checks.simulation.hosts.gateway_side import GATEWAY, GatewaySide
from checks.simulation.hosts.hub import SimulatedHub
from checks.simulation.hosts.mavlink_clients import CLIENTS
from checks.simulation.hosts.operators import RequestHistory
from checks.simulation.hosts.plant_side import WORLDS, PlantSide
from checks.simulation.hosts.robot_side import RobotSide
from checks.simulation.hosts.scheduler import Host, Scheduler, current_host
from checks.simulation.hosts.session import SimulatedSession
from checks.simulation.hosts.substitutes import SeededSecrets, SessionOpener, substituted
from checks.simulation.hosts.threads import SimulatedClock, SimulatedThread
from checks.simulation.invariants.shared import Violation
from checks.simulation.simulation import RunResult
from ground.client.operations.commands import Stopped
from ground.recording.summary import outcome_of
from robot.core import states
from robot.core.values import Pose
from runtime.units import NS_PER_MS

APP: Final = "ada-app"
TERMINALS: Final = ("ada-t1", "bea-t2", "bea-t3")
NOTEBOOK: Final = "ada-notebook"
UP: Final = "ada-up"
NAVIGATORS: Final = (states.BUG, states.BUG2)
BUSY_NS: Final = 20 * NS_PER_MS
"""`up` looks at its goal at this interval here, which costs less than each 2 ms."""


class PersonsRun:
    """All processes of a run, and what is noted of them."""

    def __init__(self, scenario: EventScenario) -> None:
        self.scenario = scenario
        self.scheduler = scheduler = Scheduler()
        self.truth = Truth(scheduler)
        self.network = ListeningNetwork(scheduler, self.truth)
        self.hub = SimulatedHub(self.network)
        self.hub.taps.append(self.truth.put)
        self.journal = Journal(scheduler)
        random = Random(f"persons {scenario.seed}")
        self._zids, self._secrets = random.getrandbits, Random(f"keys {scenario.seed}").getrandbits
        world = WORLDS[0]
        start = Pose(world.start.x_m, world.start.y_m, world.start.heading_rad)
        params = robot_side.robot_params(random.choice(NAVIGATORS))
        params = params._replace(op_lost_ms=random.choice((1500, 1500, 1000, 3000)))
        self.robot = RobotSide(scheduler, "robot", params, start, self.truth, lockstep=False)
        self.plant = PlantSide(
            scheduler, "plant", world, lambda _: None, lambda: None, lockstep=False
        )
        self.truth.plant = lambda: self.plant.plant
        programs: list[Program] = [
            App(scheduler, APP, self.journal),
            Notebook(scheduler, NOTEBOOK, self.journal),
            Up(scheduler, UP, self.journal),
            *(Shell(scheduler, name, self.journal) for name in TERMINALS),
        ]
        history = RequestHistory()
        self.gateway = GatewaySide(scheduler, GATEWAY, history)
        programs += [
            MavlinkStation(scheduler, name, self.journal, self.network, self.gateway)
            for name in CLIENTS
        ]
        self.programs = {program.name: program for program in programs}
        self.gateway.answer = self._answer
        self.gateway.arrived = lambda _system, _kind: None
        self.found: tuple[Violation, ...] = ()
        self._lines_down: set[str] = set()

    def run(self) -> RunResult:
        """Run to the end of the scenario."""
        scenario, scheduler = self.scenario, self.scheduler
        SeededSecrets.draw = lambda bits: self._secrets(bits) or 1
        SessionOpener.open = self._session
        SessionOpener.again, SessionOpener.accepts = self._fresh_session, self._accepts
        self.truth.robot_started()
        self.robot.start()
        self.plant.start()
        for event in scenario.events:
            scheduler.at(event.time_ns, self.apply, event)
        try:
            scheduler.run(scenario.duration_ns)
            self._record()
            self.found = contradictions(self.truth, self.journal, self._errors())
            first = self.found[0] if self.found else None
            return RunResult(scenario, first, self._digest(), scheduler.now_ns, self._coverage())
        finally:
            self._close()

    def apply(self, event: Event) -> None:
        """Apply an event: a deed of a program, or a fault."""
        if event.kind == "robot":
            self.robot.kill()
            self.truth.robot_started()
            self.scheduler.at(
                self.scheduler.now_ns + int(event.arguments[0]) * NS_PER_MS, self.robot.start
            )
            return
        name, *arguments = event.arguments
        if event.kind == "gateway":
            self.gateway.start()
        elif event.kind == "cut":
            self._cut(self.programs[str(name)], int(arguments[0]) * NS_PER_MS)
        else:
            program = self.programs[str(name)]
            act = {"start": self._start, "cancel": self._cancel, "kill": self._kill}.get(event.kind)
            if act is None:
                program.do(event.kind, tuple(arguments))
            else:
                act(program)

    @staticmethod
    def _start(program: Any) -> None:
        program.start()

    @staticmethod
    def _cancel(program: Program) -> None:
        program.cancel()

    @staticmethod
    def _kill(program: Program) -> None:
        program.kill()

    def _cut(self, program: Program, for_ns: int) -> None:
        """Cut a program's line to the robot for a while."""
        session, name = program.session, program.host.name
        if session is None or not program.host.alive:
            return
        self._lines_down.add(name)
        session.lose_link()
        until_ns = self.scheduler.now_ns + for_ns
        self.scheduler.at(until_ns, self._lines_down.discard, name)
        self.scheduler.at(until_ns, session.regain_link)

    def _answer(self, gateway: Host, peer: str, data: bytes) -> None:
        """Carry a frame of the gateway to the station that has this port now."""
        station: Any = self.programs.get(peer.partition(":")[0])
        if station is not None and station.peer == peer:
            self.network.send(gateway, station.host, "mavlink", station.receive, data)

    # The bus.

    def _session(self, _network: object) -> SimulatedSession:
        zid = self._zid()
        session = SimulatedSession(self.hub, zid)
        self.truth.programs[zid] = session.host.name
        return session

    def _zid(self) -> str:
        return f"{self._zids(124) + 1:032x}"

    def _accepts(self) -> bool:
        host = current_host()
        is_cut = host.name in self._lines_down
        return not is_cut and self.network.connected(host, self.robot.host)

    def _fresh_session(self) -> SimulatedSession:
        if not self._accepts():
            raise zenoh.ZError("Unable to connect")
        return SimulatedSession(self.hub, self._zid())

    # The end.

    def _record(self) -> None:
        """Say what a recording and the app say at the end of the last drive."""
        if self.truth.last_status is not None:
            self.journal.say("recorder", Recorded(outcome_of(self.truth.last_status)))
        app: Any = self.programs[APP]
        if app.host.alive and app.station is not None:
            self.journal.say(APP, Shown("last drive", app.station.last_drives()["r1"]))

    def _errors(self) -> list[tuple[str, BaseException]]:
        hosts = [self.robot.host, self.plant.host, self.gateway.host]
        hosts += [host for program in self.programs.values() for host in program.errors()]
        return [(host.name, host.error) for host in hosts if host.error is not None]

    def _digest(self) -> str:
        digest = blake2b(digest_size=16)
        for row in self.truth.rows:
            digest.update(repr(row).encode())
        for said in self.journal.words:
            digest.update(f"{said.ns} {said.program} {type(said.value).__name__}".encode())
        return digest.hexdigest()

    def _coverage(self) -> Coverage:
        coverage = Coverage(
            plant_ticks=len(self.truth.rows),
            moving_ticks=sum(abs(row.speed_m_s) > 0.01 for row in self.truth.rows),
            robot_ticks=len(self.truth.rows),
            requests=len(self.truth.answered),
            accepted=sum(one.ok for one in self.truth.answered),
            stops=sum(isinstance(said.value, Stopped) for said in self.journal.words),
        )
        coverage.reached.update({"words": len(self.journal.words)})
        coverage.reached.update(type(said.value).__name__ for said in self.journal.words)
        return coverage

    def _close(self) -> None:
        """End all processes abruptly."""
        for program in self.programs.values():
            program.kill()
        self.gateway.kill()
        self.robot.kill()
        self.plant.kill()


def replacements() -> dict[str, object]:
    """Return what the programs of persons need beside the substitutes of the simulation."""
    user = SimpleNamespace(pw_name="")

    def of_here(_uid: int) -> object:
        user.pw_name = person_of(current_host().name)
        return user

    def terminal() -> str:
        return current_host().name.partition("-")[2].partition(".")[0]

    return {
        "ground.client.link.open_bus": open_bus_here,
        "ground.client.link.WallClock": SimulatedClock,
        "ground.client.api.robot.WallClock": SimulatedClock,
        "ground.client.api.robot.ThreadPoolExecutor": SimulatedExecutor,
        "ground.client.api.robot.common": common_here,
        "ground.client.api.threads.Thread": SimulatedThread,
        "ground.client.operations.leases.gethostname": lambda: "sim",
        "ground.client.operations.leases.terminal_name": terminal,
        "ground.client.operations.leases.pwd": SimpleNamespace(getpwuid=of_here),
        "ground.launch.fleet_run.POLL_NS": BUSY_NS,
    }


@contextmanager
def patched(patches: dict[str, object]) -> Iterator[None]:
    """Replace names of modules within the context."""
    patchers = [patch(place, stand_in) for place, stand_in in patches.items()]
    begun = []
    try:
        for one in patchers:
            one.start()
            begun.append(one)
        yield
    finally:
        for one in reversed(begun):
            one.stop()


def put_back(defect: str) -> dict[str, object]:
    """Return what puts a defect back; nothing without a name."""
    return DEFECTS[defect].patches() if defect else {}


def observe(scenario: EventScenario, defect: str = "") -> RunResult:
    """Run a scenario; `defect` names a fixed defect that is put back."""
    with simulated(defect):
        return PersonsRun(scenario).run()


def contradictions_of(scenario: EventScenario, defect: str = "") -> tuple[Violation, ...]:
    """Run a scenario and return all contradictions, in the order of their times."""
    with simulated(defect):
        run = PersonsRun(scenario)
        run.run()
        return run.found


@contextmanager
def simulated(defect: str) -> Iterator[None]:
    """Simulate everything that would block, and put a defect back."""
    collects = gc.isenabled()
    gc.disable()
    try:
        with substituted(), patched(replacements()), patched(put_back(defect)):
            yield
    finally:
        if collects:
            gc.enable()
