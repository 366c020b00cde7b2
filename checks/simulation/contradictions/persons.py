"""Draw from a seed what persons do with their programs, run it, and compare what they said.

Fixed defects of words can be put back, to check that the observer finds them. Each is a patch of
product code in this process, as in `checks.simulation.defects`.
"""

from collections.abc import Callable
from hashlib import blake2b
from importlib import import_module
from random import Random
from types import SimpleNamespace
from typing import Any, Final

import zenoh
from msgspec import structs

from checks.simulation.contradictions.claims import Recorded, contradictions
from checks.simulation.contradictions.programs import (
    App,
    MavlinkStation,
    Notebook,
    PersonsProgram,
    Shell,
    Up,
    common_here,
    open_bus_here,
)
from checks.simulation.contradictions.truth import (
    Journal,
    ListeningNetwork,
    ShownText,
    Truth,
    person_of,
)
from checks.simulation.defects import Defect, Patches
from checks.simulation.hosts import robot_and_plant
from checks.simulation.hosts.bus import SimulatedHub, SimulatedSession
from checks.simulation.hosts.mavlink import CLIENTS, GATEWAY, GatewaySide
from checks.simulation.hosts.operators import RequestHistory
from checks.simulation.hosts.robot_and_plant import WORLDS, PlantSide, RobotSide
from checks.simulation.hosts.substitutes import SeededSecrets, SessionOpener, simulated
from checks.simulation.hosts.virtual_time import (
    Argument,
    Event,
    EventScenario,
    Host,
    Scheduler,
    SimulatedClock,
    current_host,
)
from checks.simulation.invariants.limits import Coverage, InvariantViolation
from checks.simulation.simulation import RunResult
from ground.client.outcomes import Stopped
from ground.recording.summary import outcome_of
from protocol import topic
from protocol.outcome import REPLACED
from protocol.topics import COMMAND, STATUS
from protocol.wire.enums import Command, MissionState
from protocol.wire.reasons import Reason
from robot.core import states
from robot.core.values import Pose
from runtime.units import NS_PER_MS, NS_PER_S


def _any_goal() -> Patches:
    """Judge `up` by the goal that has ended, whosever it is."""
    run = import_module("ground.launch.goal_run").GoalRun
    look = run.look

    async def looked(self: Any) -> None:
        newest, watch = self.telemetry.latest(STATUS), self._watch
        is_replaced = watch is not None and watch.end is not None and watch.end.outcome == REPLACED
        if not is_replaced or self.outcome is not None:
            await look(self)
        elif newest[0].goal_ended_ns:
            await self._end(newest[0])

    async def judged(self: Any, status: Any, end: Any = None) -> None:
        if end is None or end.outcome != REPLACED:
            await ended(self, status, end)

    ended = run._end
    return {
        "ground.launch.goal_run.GoalRun.look": looked,
        "ground.launch.goal_run.GoalRun._end": judged,
    }


def _unbound_clean_up() -> Patches:
    """End whatever the robot does, when a drive is cleaned up."""
    links = import_module("ground.robot")

    async def end(self: Any, request: Any, drive_id: int, attempts: int = 3) -> Any:
        if not drive_id:
            return None
        ending = links.CommandExchange(
            request, self.clock.now_ns(), attempts=attempts, patience_ns=links.END_NS
        )
        return await self.carry(ending, COMMAND)

    return {"ground.robot.Robot.end": end}


def _stop_with_lease_only() -> Patches:
    """Refuse hold, abort and disarm to whoever has not the lease."""
    original = import_module("robot.commands").needs_no_lease

    def needs_no_lease(request: Any) -> bool:
        number = getattr(request, "command", None)
        return bool(original(request)) and number in (None, Command.DO_FLIGHTTERMINATION)

    return {
        "robot.vehicle.needs_no_lease": needs_no_lease,
    }


def _lost_for_replaced() -> Patches:
    """Report a robot whose goal was replaced as one that does not answer."""
    runs = import_module("ground.launch.goal_run")
    ended = runs.GoalRun._end

    async def end(self: Any, status: Any, end: Any = None) -> None:
        if end is None or end.outcome != REPLACED:
            await ended(self, status, end)
        else:
            if self._is_lost():
                why = f"replaced by a new goal: {await self.robot.diagnosis()}"
                raise runs.NoOutcomeError(why)

    return {"ground.launch.goal_run.GoalRun._end": end}


def _lease_of_a_program() -> Patches:
    """Give the lease to a program instead of a person."""
    return {"robot.lease.person_of": lambda operator: operator}


def _constant_limit() -> Patches:
    """Promise a stop after 1.5 s, whatever the robot's parameter is."""
    texts = import_module("ground.station.link.loss")
    original = texts._without_operator

    def without_operator(status: Any, op_lost_ms: Any) -> str:
        return str(original(status, 1500.0))

    return {"ground.station.link.loss._without_operator": without_operator}


def _stale_answer() -> Patches:
    """Accept a repeated command although what it made is gone."""
    repeats = import_module("gateways.mavlink.commands.command_protocol")

    def judged(_self: Any, one: Any, **_: bool) -> Any:
        return repeats.RepeatAction.IGNORE if one.result is None else repeats.RepeatAction.ANSWER

    return {"gateways.mavlink.commands.command_protocol.Repeats._judged": judged}


def _stranger_to_itself() -> Patches:
    """Take a station that comes back from another port for another operator."""
    control = import_module("gateways.mavlink.operator_control")

    def held_by(station: Any, _sender: Any) -> Any:
        refused = control.Refused(Reason.LEASE_HELD, 0, control.name_of(station))
        return control.Answered(refused)

    return {
        "gateways.mavlink.operator_control.is_back": lambda _station, _sender: False,
        "gateways.mavlink.operator_control.held_by": held_by,
    }


def _failed_for_taken_over() -> Patches:
    """Call every mission failed that has not been completed."""
    return {"ground.client.missions.mission_state": lambda state, *_: MissionState(state).name}


def _nobody_named() -> Patches:
    """Name nobody who has stopped what another person had begun."""
    return {"robot.commands.Commands._note_stopper": lambda *_: None}


def _holder_for_doer() -> Patches:
    """Name a doer by the name under which its person last took the lease."""
    vehicle = import_module("robot.vehicle").RobotVehicle
    original = vehicle.receive

    def receive(self: Any, request: Any, now_ns: int, operator: str = "") -> Any:
        if hasattr(request, "sender"):
            person = topic.person_of(operator)
            names = self.lease._names.items()
            known = [name for one, name in names if topic.person_of(one) == person]
            request = structs.replace(request, sender=(known or [""])[-1])
        return original(self, request, now_ns, operator)

    return {"robot.vehicle.RobotVehicle.receive": receive}


def _no_notes() -> Patches:
    """Say ok, and no more, of what had nothing to act on."""
    return {"robot.commands.Commands._note_on": lambda *_: 0}


def _done_for_replaced() -> Patches:
    """Say of a drive by hand that it is done although another one has replaced it."""
    return {
        "ground.client.teleop_sender.DriveWatch._replaced": lambda *_: None,
        "ground.robot.DRIVE_REPLACED": "",
    }


DEFECTS: Final[dict[str, Defect]] = {
    "c1": Defect("`up` reports the end of somebody else's goal", _any_goal),
    "c2": Defect("a clean-up ends what was begun since", _unbound_clean_up),
    "c3": Defect("what stops is refused without the lease", _stop_with_lease_only),
    "c4": Defect("a replaced goal is reported as a lost robot", _lost_for_replaced),
    "c5": Defect("the lease belongs to a program, not to a person", _lease_of_a_program),
    "c6": Defect("a screen promises a stop at a time that is not the robot's", _constant_limit),
    "c7": Defect("a repeated command is accepted though its effect is gone", _stale_answer),
    "c8": Defect(
        "a station that restarts is told that another operator commands", _stranger_to_itself
    ),
    "c9": Defect("a mission that was taken over is reported as failed", _failed_for_taken_over),
    "c10": Defect("who has aborted another person's goal is not named", _nobody_named),
    "c11": Defect("what had nothing to act on is said to be done", _no_notes),
    "c12": Defect("a drive that another one has replaced is said to be done", _done_for_replaced),
    "c13": Defect("a doer has the name of another program of its person", _holder_for_doer),
}


DURATION_NS: Final = 24 * NS_PER_S
LAST_NS: Final = 18 * NS_PER_S
"""After this time nothing is begun, so that what was begun can end and be said."""

Arguments = tuple[Argument, ...]


def place(random: Random) -> Arguments:
    """Draw a place near the start; each is another one, so that goals can be told apart."""
    return (
        round(30.0 + random.uniform(-0.6, 1.6), 2),
        round(30.0 + random.uniform(-0.8, 0.8), 2),
    )


def far(random: Random) -> Arguments:
    """Draw a place that is not reached in the run."""
    return round(36.0 + random.random(), 2), round(30.0 + random.uniform(-1.0, 1.0), 2)


def spot(random: Random) -> Arguments:
    """Draw a place, near or far."""
    return random.choice((place, place, far))(random)


def speeds(random: Random) -> Arguments:
    """Draw speed, turn and time of a drive by hand."""
    return (
        random.choice((0.2, 0.3, -0.2)),
        random.choice((0.0, 0.0, 0.5)),
        random.choice((1.0, 2.0, 4.0)),
    )


def moving(random: Random) -> Arguments:
    """Draw a deed that drives."""
    return random.choice(
        (
            lambda: ("goto", *spot(random)),
            lambda: ("goto", *spot(random)),
            lambda: ("goto", *far(random), random.choice((1.5, 3.0))),
            lambda: ("drive", *speeds(random)),
        )
    )()


def mission(random: Random) -> Arguments:
    """Draw the stops of a mission."""
    stops = [place(random) for _ in range(random.choice((1, 2, 3)))]
    return tuple(number for stop in stops for number in stop)


def shell(random: Random) -> Arguments:
    """Draw a command of a shell."""
    return draw(random, SHELL)


def cell(random: Random) -> Arguments:
    """Draw a cell of the notebook; `then` begins it as what is under way is cancelled."""
    return draw(random, CELLS)


def typed(random: Random) -> Arguments:
    """Draw a line that is typed in the app."""
    return draw(random, TYPED)


def sent(random: Random) -> Arguments:
    """Draw what a MAVLink station does."""
    return draw(random, SENT)


def draw(random: Random, table: "Table") -> Arguments:
    """Draw from a table."""
    (one,) = random.choices(table, [weight for weight, _ in table])
    return one[1](random)


Table = tuple[tuple[int, Callable[[Random], Arguments]], ...]
STOPS: Final[Table] = (
    (3, lambda _: ("hold",)),
    (3, lambda _: ("abort",)),
    (3, lambda _: ("disarm",)),
    (1, lambda _: ("estop",)),
)
COMMON: Final[Table] = (
    *STOPS,
    (2, lambda _: ("arm",)),
    (2, lambda _: ("resume",)),
    (2, lambda _: ("clear",)),
    (1, lambda _: ("take",)),
    (1, lambda _: ("seize",)),
    (1, lambda _: ("release",)),
    (1, lambda _: ("lease",)),
)
SHELL: Final[Table] = ((12, moving), (4, lambda _: ("cancel",)), *COMMON)
CELLS: Final[Table] = (
    (8, moving),
    (3, lambda random: ("limited", *far(random), random.choice((1.0, 2.0, 3.0)))),
    (8, lambda random: ("then", *moving(random))),
    (2, lambda random: ("mission", *mission(random))),
    (3, lambda _: ("cancel",)),
    *COMMON,
)
TYPED: Final[Table] = (
    (8, lambda random: ("goto", *spot(random))),
    (4, lambda random: ("drive", *speeds(random))),
    (3, lambda random: ("mission", *mission(random))),
    *(one for one in COMMON if one[1](Random(0)) != ("lease",)),
)
SENT: Final[Table] = (
    (6, lambda random: ("drive", *spot(random))),
    (4, lambda random: ("target", *spot(random))),
    (
        4,
        lambda random: (
            "steer",
            random.choice(("MANUAL", "GUIDED")),
            random.choice((1.0, 0.5)),
            random.choice((1.0, 3.0)),
        ),
    ),
    (8, lambda _: ("arm",)),
    (2, lambda _: ("disarm", 0)),
    (8, lambda random: ("mode", random.choice(("GUIDED", "GUIDED", "HOLD", "MANUAL")))),
    (2, lambda random: ("pause", random.randrange(2))),
    (2, lambda _: ("stop",)),
    (2, lambda _: ("clear", 0)),
    (3, lambda _: ("restart",)),
)

FOLLOWED: Final = 0.35
"""Share of deeds that drive after which another one follows soon, mostly one that stops or drives.
"""

UNDONE: Final = {"arm": ("disarm", "estop"), "mode": ("hold",)}
"""Commands of a MAVLink station, and what undoes them."""

REPEATED: Final = 0.6
"""Share of them that are sent again soon, after somebody has undone them."""

TAKEN_OVER: Final = 0.5
"""Share of missions that are taken over by hand."""

CUT: Final = 0.2
"""Share of drives of a program during which it loses its link for some seconds."""


def draw_persons(seed: int) -> EventScenario:
    """Return the scenario of a seed: two persons, programs of theirs, and MAVLink stations."""
    random = Random(f"persons {seed}")
    programs: dict[str, Callable[[Random], Arguments]] = {
        TERMINALS[0]: shell,
        TERMINALS[1]: shell,
        NOTEBOOK: cell,
        APP: typed,
    }
    chosen = random.sample(tuple(programs), random.choice((2, 3, 3, 4)))
    started = [name for name in (APP, NOTEBOOK) if name in chosen]
    events = [Event(300 * NS_PER_MS, "start", (name,), 0) for name in started]
    if random.random() < 0.3:
        events.append(_event(random, 2, UP, ("up", *spot(random))))
    if seed % 4 == 3:
        events.append(Event(200 * NS_PER_MS, "gateway", (GATEWAY,), 0))
        stations = random.sample(tuple(CLIENTS), random.choice((1, 2)))
        for name in stations:
            events.append(Event(400 * NS_PER_MS, "start", (name,), 0))
            programs[name] = sent
        chosen = random.sample(chosen, random.randrange(len(chosen))) + stations
    for _ in range(random.randint(4, 10)):
        name = random.choice(chosen)
        events += _with_followers(random, name, programs[name](random), chosen, programs)
    return EventScenario(seed, DURATION_NS, tuple(sorted(events)))


def _with_followers(
    random: Random,
    name: str,
    deed: Arguments,
    chosen: list[str],
    programs: dict[str, Callable[[Random], Arguments]],
) -> list[Event]:
    """Return a deed and, at times, what soon follows it: by the same program or another one."""
    first = _event(random, LAST_NS // NS_PER_S, name, deed)
    events = [first]
    drives = deed[0] in ("goto", "drive", "mission")
    if name in (APP, NOTEBOOK) and drives and random.random() < CUT:
        gap_ms, for_ms = random.randrange(500, 3000), random.choice((1000, 3000, 6000))
        events.append(_later(first, gap_ms, name, ("cut", for_ms)))
    if deed[0] == "restart":
        events.append(_later(first, -random.randrange(500, 2500), name, ("arm",)))
        events.append(_later(first, random.randrange(900, 2500), name, draw(random, SENT[:4])))
    elif deed[0] in UNDONE and random.random() < REPEATED:
        gap_ms = random.randrange(300, 1400)
        other = random.choice(chosen)
        undone = ("stop",) if other in CLIENTS else (random.choice(UNDONE[str(deed[0])]),)
        events.append(_later(first, gap_ms // 2, other, undone))
        events.append(_later(first, gap_ms, name, deed))
    elif deed[0] == "mission" and random.random() < TAKEN_OVER:
        events.append(_later(first, random.randrange(1000, 4000), name, ("drive", *speeds(random))))
    elif random.random() < FOLLOWED:
        other = random.choice((name, random.choice(chosen)))
        events.append(_later(first, random.randrange(100, 4000), other, programs[other](random)))
    return events


def _event(random: Random, within_s: int, name: str, deed: Arguments) -> Event:
    time_ns = (500 + round(random.random() * (within_s * 1000 - 500))) * NS_PER_MS
    return Event(time_ns, str(deed[0]), (name, *deed[1:]), 0)


def _later(first: Event, gap_ms: int, name: str, deed: Arguments) -> Event:
    return Event(first.time_ns + gap_ms * NS_PER_MS, str(deed[0]), (name, *deed[1:]), 0)


APP: Final = "ada-app"
TERMINALS: Final = ("ada-t1", "bea-t2", "bea-t3")
NOTEBOOK: Final = "ada-notebook"
UP: Final = "ada-up"
NAVIGATORS: Final = (states.BUG, states.BUG2)


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
        params = robot_and_plant.robot_params(random.choice(NAVIGATORS))
        params = params._replace(op_lost_ms=random.choice((1500, 1500, 1000, 3000)))
        self.robot = RobotSide(scheduler, "robot", params, start, self.truth, lockstep=False)
        self.plant = PlantSide(
            scheduler, "plant", world, lambda _: None, lambda: None, lockstep=False
        )
        self.truth.plant = lambda: self.plant.plant
        programs: list[PersonsProgram] = [
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
        self.found: tuple[InvariantViolation, ...] = ()
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
    def _cancel(program: PersonsProgram) -> None:
        program.cancel()

    @staticmethod
    def _kill(program: PersonsProgram) -> None:
        program.kill()

    def _cut(self, program: PersonsProgram, for_ns: int) -> None:
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
            self.journal.say(APP, ShownText("last drive", app.station.last_drives()["r1"]))

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
        "ground.client.robot_link.open_bus": open_bus_here,
        "ground.client.robot_link.WallClock": SimulatedClock,
        "ground.robot.common": common_here,
        "ground.client.lease_holder.gethostname": lambda: "sim",
        "ground.client.lease_holder.terminal_name": terminal,
        "ground.client.lease_holder.pwd": SimpleNamespace(getpwuid=of_here),
    }


def run_persons(scenario: EventScenario, defect: str) -> tuple[PersonsRun, RunResult]:
    """Run a scenario; `defect` names a fixed defect that is put back."""
    with simulated(replacements, *((DEFECTS[defect].patches,) if defect else ())):
        run = PersonsRun(scenario)
        return run, run.run()


def observe(scenario: EventScenario, defect: str = "") -> RunResult:
    """Run a scenario and return its result."""
    return run_persons(scenario, defect)[1]


def contradictions_of(scenario: EventScenario, defect: str = "") -> tuple[InvariantViolation, ...]:
    """Run a scenario and return all contradictions, in the order of their times."""
    return run_persons(scenario, defect)[0].found
