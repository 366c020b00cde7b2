"""A run of a scenario: all processes, a violation or none, and a reproducible digest.

The kinds of events of a scenario are here, too, and how each is drawn and applied.
"""

from collections.abc import Callable, Mapping
from functools import partial
from random import Random
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import zenoh

from checks.simulation.hosts import robot_and_plant
from checks.simulation.hosts.attacker import ATTACKS, OWN_NAME, SimulatedAttacker
from checks.simulation.hosts.bus import (
    LinkImpairment,
    SimulatedHub,
    SimulatedNetwork,
    SimulatedQuery,
    SimulatedSample,
    SimulatedSession,
    path_of,
)
from checks.simulation.hosts.mavlink import CLIENTS, GATEWAY, GatewaySide, SimulatedClient
from checks.simulation.hosts.operators import RequestHistory, SimulatedOperator, StationOperator
from checks.simulation.hosts.robot_and_plant import WORLDS, PlantSide, RobotSide
from checks.simulation.hosts.substitutes import SeededSecrets, SessionOpener
from checks.simulation.hosts.virtual_time import (
    OPERATORS,
    STATION,
    Argument,
    Event,
    EventScenario,
    Host,
    Scheduler,
    current_host,
)
from checks.simulation.invariants.limits import Coverage, InvariantViolation
from checks.simulation.invariants.oracle import Oracle
from protocol.bus.network import Network
from robot.core import states
from robot.core.values import Pose
from runtime.units import NS_PER_MS, PERIOD_NS

FALSE_STAMPS_NS: Final = 15_000 * NS_PER_MS
"""After a false time stamp the robot may misjudge its sender for this long."""

OF_ONE_PERSON: Final = 0.4
"""Share of seeds in which two operators are programs of one person."""

NAVIGATORS: Final = (states.BUG, states.VGM, states.BUG2)


class RunResult(NamedTuple):
    """The end of a run."""

    scenario: EventScenario
    violation: InvariantViolation | None
    digest: str
    simulated_ns: int
    coverage: Coverage


class Simulation:
    """All processes of a run, on which the events of the scenario act."""

    def __init__(self, scenario: EventScenario) -> None:
        random = Random(f"setting {scenario.seed}")
        self.scenario = scenario
        self.scheduler = scheduler = Scheduler()
        self.network = SimulatedNetwork(scheduler)
        self.hub = SimulatedHub(self.network)
        self.history = RequestHistory()
        self.oracle = Oracle(scheduler, self.history)
        self._zids = {one: Random(f"{one}zids {scenario.seed}") for one in ("", GATEWAY)}
        world = WORLDS[0] if random.random() < 0.8 else WORLDS[1]
        params = robot_and_plant.robot_params(random.choice(NAVIGATORS))
        start = Pose(world.start.x_m, world.start.y_m, world.start.heading_rad)
        self.world = world
        self.robot = RobotSide(
            scheduler, "robot", params, start, self.oracle, lockstep=scenario.lockstep
        )
        self.robot.clock_offset_ns = random.randrange(1, 10**14)
        self.plant = PlantSide(
            scheduler,
            "plant",
            world,
            self.oracle.plant_tick,
            self.oracle.plant_started,
            lockstep=scenario.lockstep,
        )
        self.operators = {
            name: (StationOperator if name == STATION else SimulatedOperator)(
                scheduler, name, self.history
            )
            for name in OPERATORS
        }
        for operator in self.operators.values():
            operator.centre = (start.x_m, start.y_m)
        draw = Random(f"persons {scenario.seed}")
        if draw.random() < OF_ONE_PERSON:
            one, other = draw.sample(OPERATORS, 2)
            self.operators[one].person = self.operators[other].person
        gateway = GatewaySide(scheduler, GATEWAY, self.history)
        self.gateway = self.operators[GATEWAY] = gateway
        self.clients = {
            name: SimulatedClient(scheduler, self.network, gateway, name, self.history)
            for name in CLIENTS
        }
        gateway.answer, gateway.arrived = self._answer, self.oracle.clients.arrived
        facts = self.oracle.facts
        facts.robot = self.robot
        self.attacker = SimulatedAttacker(
            scheduler,
            self.hub,
            lambda: self.robot.host.now_ns(),
            lambda: facts.plant_ns,
            self.false_stamp,
        )
        self.hub.taps.append(self._tap)
        self.hub.arrivals.append(self._arrived)
        self.hub.asked.append(self._asked)
        self._operator_of: dict[str, str] = {}
        self.lines_down: set[str] = set()
        """Hosts whose line to the robot is down."""
        self.handshakes_fail = False

    def run(self) -> RunResult:
        """Run to the end of the scenario or to the first violation."""
        scenario, scheduler = self.scenario, self.scheduler
        draws = {one: Random(f"{one}secrets {scenario.seed}").getrandbits for one in ("", GATEWAY)}
        SeededSecrets.draw = lambda bits: draws[stream()](bits) or 1
        SessionOpener.open = self._session
        SessionOpener.again, SessionOpener.accepts = self._fresh_session, self._accepts
        self.start_robot()
        self.plant.start()
        for event in scenario.events:
            scheduler.at(event.time_ns, FAULTS[event.kind].apply, self, event)
        step_ns = 50 * NS_PER_MS
        try:
            for now_ns in range(step_ns, scenario.duration_ns + 1, step_ns):
                scheduler.run(now_ns)
                self._judge()
                if self.oracle.facts.violation is not None:
                    break
        finally:
            self._close()
        return RunResult(
            scenario,
            self.oracle.facts.violation,
            self.oracle.digest.hexdigest(),
            scheduler.now_ns,
            self.oracle.facts.coverage,
        )

    # Called by events.

    def start_robot(self) -> None:
        """Start the robot."""
        self.oracle.robot_started()
        self.robot.start()

    def host(self, name: str) -> Host:
        """Return the host of a process."""
        if name == "robot":
            return self.robot.host
        if name == "plant":
            return self.plant.host
        if name in self.clients:
            return self.clients[name].host
        return self.operators[name].host if name in self.operators else self.attacker.host

    def start_gateway(self) -> None:
        """Start the gateway and its clients."""
        self.gateway.start()
        for client in self.clients.values():
            client.start()

    def false_stamp(self) -> None:
        """Note that an operator's frame carries a false time stamp."""
        self.oracle.presence.false_stamps_until_ns = self.scheduler.now_ns + FALSE_STAMPS_NS

    # Observation of the bus.

    def _session(self, network: Network) -> SimulatedSession:
        zid = self._zid()
        session = SimulatedSession(self.hub, zid)
        operator = self._operator_of[session.host.name] = f"{network.person}/{zid}"
        if session.host.name == GATEWAY:
            self.oracle.clients.operator = operator
        return session

    def _zid(self) -> str:
        return f"{self._zids[stream()].getrandbits(124) + 1:032x}"

    def accepts(self, host: Host) -> bool:
        """Return whether the robot accepts a connection of a host."""
        is_down = host.name in self.lines_down
        return not is_down and self.network.connected(host, self.robot.host)

    def _accepts(self) -> bool:
        return self.accepts(current_host())

    def _fresh_session(self) -> SimulatedSession:
        """Open a fresh session of an operator, which keeps its identity."""
        if self.handshakes_fail or not self._accepts():
            raise zenoh.ZError("Unable to connect")
        return SimulatedSession(self.hub, self._zid())

    def _tap(self, source: Host, key: str, frame: bytes, note: bytes | None, asked: bool) -> None:
        if source is not self.attacker.host:
            self.attacker.capture(key, frame, note, asked=asked)
        if not asked:
            self.oracle.put(source, path_of(key), frame)
        elif source.name == GATEWAY and frame:
            self.oracle.clients.asked(frame)

    def _answer(self, gateway: Host, peer: str, data: bytes) -> None:
        """Carry a frame of the gateway to a client."""
        if peer in self.clients:
            client = self.clients[peer]
            self.network.send(gateway, client.host, "mavlink", client.receive, data)

    def _arrived(self, sample: SimulatedSample) -> None:
        """Pass on a frame that an operator sent under its own name and that reached the robot."""
        source, path = sample.source, path_of(sample.key_expr)
        self.oracle.stops.arrived(source.name, path, sample.payload)
        mine = OWN_NAME if source is self.attacker.host else self._operator_of.get(source.name, "")
        if path.endswith(f"/{mine}"):
            self.oracle.presence.arrived(path, sample.payload, sample.sent_ns)

    def _asked(self, query: SimulatedQuery) -> None:
        """Pass on a request that reached the robot."""
        self.oracle.stops.arrived(query.source.name, path_of(query.key_expr), query.payload or b"")

    def _judge(self) -> None:
        hosts = [operator.host for operator in self.operators.values()]
        hosts += [client.host for client in self.clients.values()]
        self.oracle.judge_ended([self.robot.host, self.plant.host, self.attacker.host, *hosts])

    def _close(self) -> None:
        """End all processes abruptly."""
        for operator in self.operators.values():
            operator.kill()
        for client in self.clients.values():
            client.host.kill()
        self.robot.kill()
        self.plant.kill()


def stream() -> str:
    """Return the stream of random numbers of the running host: the gateway has one of its own."""
    return GATEWAY if current_host().name == GATEWAY else ""


Arguments = tuple[Argument, ...]


def draw_operate(random: Random, first: str = OPERATORS[0]) -> Arguments:
    """Draw an operator, mostly the first, and an action, mostly one that leads to driving."""
    name = random.choice((first, first, first, first, *OPERATORS[1:3]))
    return (name, *ACTIONS[random.choices(range(len(ACTIONS)), WEIGHTS)[0]][1](random))


def place(random: Random) -> tuple[float, float]:
    """Draw a position near the start, mostly ahead."""
    return (
        round(30.0 + random.uniform(-1.0, 3.0), 2),
        round(30.0 + random.uniform(-1.0, 1.0), 2),
    )


def mission(random: Random) -> Arguments:
    """Draw stops close to each other, so that many of them are reached."""
    near = [(random.uniform(-0.2, 1.2), random.uniform(-0.7, 0.7)) for _ in range(4)]
    stops = [round(30.0 + off_m, 2) for stop in near[random.randrange(3) :] for off_m in stop]
    return ("mission", random.choice((0.0, 0.5, 2.0)), *stops)


def draw_client(random: Random) -> Arguments:
    """Draw a client of the gateway, mostly the first, and an action."""
    name = random.choice((*CLIENTS, next(iter(CLIENTS))))
    weights = [weight for weight, _ in CLIENT_ACTIONS]
    return (name, *random.choices(CLIENT_ACTIONS, weights)[0][1](random))


SAFETY: Final = (
    ("guard_stop_m", 0.0),
    ("guard_stop_m", 0.06),
    ("op_lost_ms", 60_000.0),
    ("op_lost_ms", 1000.0),
    ("wheel_max_m_s", 0.2),
    ("freeze_m", 5.0),
)
"""Safety parameters with values that are safer and less safe than the configured ones."""

ACTIONS: Final[tuple[tuple[int, Callable[[Random], Arguments]], ...]] = (
    (8, lambda random: ("drive", *place(random), "GUIDED")),
    (4, lambda random: ("drive", *place(random), "AUTO")),
    (6, mission),
    (
        5,
        lambda random: (
            "teleop",
            random.choice((0.3, 0.2, -0.2)),
            random.choice((0.0, 0.0, 0.8)),
            random.choice((0.5, 1.5, 4.0)),
        ),
    ),
    (4, lambda _: ("stop",)),
    (2, lambda _: ("order", "clear-estop")),
    (1, lambda _: ("order", "arm")),
    (2, lambda _: ("order", "disarm")),
    (2, lambda _: ("order", "hold")),
    (2, lambda _: ("order", "resume")),
    (1, lambda _: ("order", "abort")),
    (2, lambda _: ("order", "rtl")),
    (4, lambda random: ("mode", random.choice(("GUIDED", "GUIDED", "AUTO", "HOLD", "MANUAL")))),
    (3, lambda random: ("lease", random.choice(("TAKE", "SEIZE", "SEIZE", "RELEASE")))),
    (3, lambda random: ("param", "d_obs_m", random.choice((0.2, 0.25, 0.31)))),
    (2, lambda random: ("param", *random.choice(SAFETY))),
    (3, lambda random: ("fence", random.choice((0.0, 0.8, 1.5, 5.0)), random.randrange(2))),
)
CLIENT_ACTIONS: Final[tuple[tuple[int, Callable[[Random], Arguments]], ...]] = (
    (6, lambda random: ("drive", *place(random))),
    (4, lambda random: ("target", *place(random))),
    (
        6,
        lambda random: (
            "steer",
            random.choice(("MANUAL", "GUIDED")),
            random.choice((1.0, 0.5, -0.5)),
            random.choice((0.5, 1.5, 4.0)),
        ),
    ),
    (2, lambda _: ("stop",)),
    (3, lambda random: ("clear", random.randrange(2))),
    (2, lambda _: ("arm",)),
    (2, lambda random: ("disarm", random.randrange(2))),
    (3, lambda random: ("mode", random.choice(("GUIDED", "HOLD", "MANUAL", "SMART_RTL")))),
    (3, lambda random: ("pause", random.randrange(2))),
    (2, lambda random: ("control", random.randrange(2))),
    (2, lambda random: ("flood", random.choice((6, 30)))),
    (4, lambda random: ("silence", random.choice((1.0, 3.0, 6.0, 10.0)))),
    (
        4,
        lambda random: (
            "forge",
            random.choice(("noise", "torn", "echo", "stranger")),
            random.getrandbits(32),
        ),
    ),
)
"""The actions of the gateway's clients."""

WEIGHTS: Final = [weight for weight, _ in ACTIONS]


def draw_driving(random: Random) -> Arguments:
    """Draw an action that drives."""
    return random.choice(ACTIONS[:4])[1](random)


HOSTS: Final = ("robot", "plant", *OPERATORS)
MEASURED_NS: Final = 2_700 * NS_PER_MS
"""An operator measures the robot's clock every 2 s and has the answer within 0.5 s."""

REPLACED_NS: Final = 1_500 * NS_PER_MS
"""A session whose id is taken is replaced after 1 s without a link; attempts are 0.1 s apart."""

LOOKS_MS: Final = 50
"""Time between two looks whether a session that was kept out has been replaced."""

REFUSED_MS: Final = 1500
"""Handshakes fail for so long; the next attempt is 2 s after the first."""

HUNG_MS: Final = 1500
"""A robot that hangs for so long is killed by its watchdog."""

STOOD_NS: Final = 3_200 * NS_PER_MS
"""Ages on the plant's clock, which stood still, are of wall time again after this: the lease's."""

QUEUED_SYNCS: Final = 12
"""Two for each of the files that may wait for the disk."""

TOPIC_GROUPS: Final = ("", "sense/", "drive/", "op/", "tlm/", "srv/", "op/heartbeat")


class ScenarioEventKind(NamedTuple):
    """`weight` is the relative frequency; `draw` returns the arguments."""

    weight: int
    draw: Callable[[Random], Arguments]
    apply: Callable[[Simulation, Event], None]


def after(
    simulation: Simulation, delay_ms: int, action: Callable[..., object], *arguments: Any
) -> int:
    """Call `action` after a delay, and return that time."""
    when_ns = simulation.scheduler.now_ns + delay_ms * NS_PER_MS
    simulation.scheduler.at(when_ns, action, *arguments)
    return when_ns


# Network.


def pair(random: Random) -> tuple[str, str]:
    """Draw two hosts, one of them the robot."""
    other = random.choice(HOSTS[1:])
    return (("robot", other), (other, "robot"))[random.randrange(2)]


def span_ms(random: Random) -> int:
    """Draw a duration: mostly short, at times some seconds."""
    return random.choice((60, 120, 200, 300, 500, 800, 1200, 2000, 4000))


def draw_rough(random: Random) -> Arguments:
    """Draw a link and its loss, duplication, reordering, delay and jitter."""
    source, target = pair(random)
    return (
        source,
        target,
        random.choice(TOPIC_GROUPS),
        random.choice((0.0, 0.0, 0.1, 0.3, 0.6, 0.9)),
        random.choice((0.0, 0.0, 0.2, 0.6)),
        random.choice((0.0, 0.0, 0.2, 0.6)),
        random.choice((0, 0, 0, 20, 100, 300, 1000, 3000)),
        random.choice((0, 0, 30, 150)),
        span_ms(random) * 2,
    )


def apply_rough(simulation: Simulation, event: Event) -> None:
    """Disturb a link."""
    source, target, group, loss, double, swap, delay_ms, jitter_ms, for_ms = event.arguments
    impairment = LinkImpairment(
        loss=float(loss),
        duplicate=float(double),
        reorder=float(swap),
        delay_ns=int(delay_ms) * NS_PER_MS,
        jitter_ns=int(jitter_ms) * NS_PER_MS,
        paths=(str(group),) if group else (),
    )
    late_ms = int(delay_ms) + int(jitter_ms) + 400
    impair(simulation, event, [(str(source), str(target))], impairment, int(for_ms), late_ms)


def apply_queue(simulation: Simulation, event: Event) -> None:
    """Let the delay of a link grow slowly, so that frames arrive ever later but are not lost."""
    source, target, growth, for_ms = event.arguments
    impairment = LinkImpairment(growth=float(growth), since_ns=simulation.scheduler.now_ns)
    impair(simulation, event, [(str(source), str(target))], impairment, int(for_ms), 4400)


def apply_cut(simulation: Simulation, event: Event) -> None:
    """Cut a link in one or both directions."""
    source, target, both, for_ms = event.arguments
    links = [(str(source), str(target))]
    if both:
        links.append((str(target), str(source)))
    impair(simulation, event, links, LinkImpairment(loss=1.0), int(for_ms), 0)


def impair(
    simulation: Simulation,
    event: Event,
    links: list[tuple[str, str]],
    impairment: LinkImpairment,
    for_ms: int,
    late_ms: int,
) -> None:
    """Impair links for a while; frames may arrive until `late_ms` after that."""
    until_ns = simulation.scheduler.now_ns + for_ms * NS_PER_MS
    simulation.oracle.facts.impaired(until_ns + late_ms * NS_PER_MS)
    for number, (source, target) in enumerate(links):
        link = simulation.network.link(source, target)
        link.add(impairment, event.salt + number)
        after(simulation, for_ms, link.remove, impairment)


def draw_link(random: Random) -> Arguments:
    """Draw an operator whose link breaks, what happens to its place, and for how long."""
    how = random.choice(("broken", "taken", "taken", "refused"))
    for_ms = random.choice((300, 1000, 3000) if how == "broken" else (4000, 8000))
    return random.choice(OPERATORS), how, for_ms


def apply_link(simulation: Simulation, event: Event) -> None:
    """Break an operator's link.

    `broken`: it comes back. `taken`: the robot accepts connections, but another process has taken
    the session's id. `refused`: in addition, handshakes of fresh sessions fail for some time.
    """
    name, how, for_ms = str(event.arguments[0]), str(event.arguments[1]), int(event.arguments[2])
    operator, facts = simulation.operators[name], simulation.oracle.facts
    if operator.bus is None or not operator.host.alive:
        return
    session: Any = operator.bus._session
    session.lose_link()
    until_ns = after(simulation, for_ms, session.regain_link)
    if how == "broken":
        simulation.lines_down.add(name)
        after(simulation, for_ms, simulation.lines_down.discard, name)
        facts.impaired(until_ns)
        facts.unsure(until_ns)
        return
    within_ns = REPLACED_NS
    if how == "refused":
        simulation.handshakes_fail = True
        after(simulation, REFUSED_MS, setattr, simulation, "handshakes_fail", False)
        within_ns += 2 * REPLACED_NS
    await_replaced(simulation, name, session, within_ns)


def await_replaced(
    simulation: Simulation, name: str, session: Any, within_ns: int, *, again: bool = False
) -> None:
    """Note that an operator is not heard until its session is replaced.

    That takes `within_ns` while its process runs and can reach the robot, and begins anew later.
    """
    operator, facts = simulation.operators[name], simulation.oracle.facts
    bus, host = operator.bus, operator.host
    if session.linked or bus is None or bus._session is not session:
        return
    if not again or host.suspended or not simulation.accepts(host):
        facts.impaired(simulation.scheduler.now_ns + within_ns)
        facts.unsure(simulation.scheduler.now_ns + within_ns)
    look = partial(await_replaced, simulation, name, session, within_ns, again=True)
    after(simulation, LOOKS_MS, look)


# Processes.


def restart_robot(simulation: Simulation, back_ms: int) -> None:
    """Start the killed robot again after a time."""
    back_ns = after(simulation, back_ms, simulation.start_robot)
    simulation.oracle.facts.held_up(back_ns + 1000 * NS_PER_MS)


def draw_kill(random: Random) -> Arguments:
    """Draw a process and the time until its restart."""
    back_ms = random.choice((100, 300, 1000, 2500, 60_000))
    return random.choice(("robot", "robot", "plant", *OPERATORS)), back_ms


def apply_kill(simulation: Simulation, event: Event) -> None:
    """Kill a process and restart it."""
    name, back_ms = str(event.arguments[0]), int(event.arguments[1])
    if name == "robot":
        simulation.robot.kill()
        restart_robot(simulation, back_ms)
        return
    process = simulation.plant if name == "plant" else simulation.operators[name]
    process.kill()
    back_ns = after(simulation, back_ms, process.start)
    simulation.oracle.facts.held_up(back_ns + 1000 * NS_PER_MS)


def draw_restart(random: Random) -> Arguments:
    """Draw how the robot ends, and the time until its restart in ms."""
    return random.choice(("killed", "hung", "without power")), random.choice((100, 300, 1000))


def apply_restart(simulation: Simulation, event: Event) -> None:
    """End the robot as its supervisor or the lack of power would, and start it again."""
    how, back_ms = str(event.arguments[0]), int(event.arguments[1])
    if how == "hung":
        simulation.robot.hang_ns += HUNG_MS * NS_PER_MS
        after(
            simulation,
            HUNG_MS,
            apply_kill,
            simulation,
            event._replace(arguments=("robot", back_ms)),
        )
        return
    simulation.robot.kill()
    if how == "without power":
        simulation.robot.disk.cut_power(event.salt)
    restart_robot(simulation, back_ms)


def apply_stand(simulation: Simulation, event: Event) -> None:
    """Let the plant's clock stand still for a while, in lockstep."""
    facts = simulation.oracle.facts
    simulation.plant.stand(still=True)
    until_ns = after(
        simulation, int(event.arguments[0]), partial(simulation.plant.stand, still=False)
    )
    facts.awake_ns = max(facts.awake_ns, until_ns)
    facts.stands_until_ns = max(facts.stands_until_ns, until_ns + PERIOD_NS)
    facts.unsure(until_ns + STOOD_NS)


def apply_suspend(simulation: Simulation, event: Event) -> None:
    """Suspend a process for a while."""
    name, for_ms = str(event.arguments[0]), int(event.arguments[1])
    host, facts = simulation.host(name), simulation.oracle.facts
    host.suspend()
    until_ns = after(simulation, for_ms, host.resume)
    facts.held_up(until_ns + 300 * NS_PER_MS)
    facts.impaired(until_ns + 300 * NS_PER_MS)
    if name == "plant":
        facts.awake_ns = until_ns


def apply_hang(simulation: Simulation, event: Event) -> None:
    """Let the robot's loop hang while its bus continues."""
    simulation.robot.hang_ns += int(event.arguments[0]) * NS_PER_MS


def apply_busy(simulation: Simulation, event: Event) -> None:
    """Let each tick of the robot take longer, in wall time and in CPU time."""
    late_ms, for_ms = int(event.arguments[0]), int(event.arguments[1])
    robot = simulation.robot
    robot.late_ns, robot.stage_cost_ns = late_ms * NS_PER_MS, late_ms * NS_PER_MS // 5
    after(simulation, for_ms, end_busy, simulation)


def end_busy(simulation: Simulation) -> None:
    """Let ticks take their usual time again."""
    simulation.robot.late_ns, simulation.robot.stage_cost_ns = 0, 100_000


# Disk.


def apply_slow_disk(simulation: Simulation, event: Event) -> None:
    """Slow down each fsync for a while."""
    disk = simulation.robot.disk
    disk.slow_ns = int(event.arguments[0]) * NS_PER_MS
    until_ns = after(simulation, int(event.arguments[1]), setattr, disk, "slow_ns", 0)
    disturb_disk(simulation, until_ns + QUEUED_SYNCS * disk.slow_ns)


def apply_failing_disk(simulation: Simulation, event: Event) -> None:
    """Let writes fail for a while."""
    disk = simulation.robot.disk
    disk.failing = True
    disturb_disk(
        simulation, after(simulation, int(event.arguments[0]), setattr, disk, "failing", False)
    )


def disturb_disk(simulation: Simulation, until_ns: int) -> None:
    """Note that nothing needs to be on the disk in time until then."""
    facts = simulation.oracle.facts
    facts.disk_until_ns = max(facts.disk_until_ns, until_ns)


def apply_power_cut(simulation: Simulation, event: Event) -> None:
    """Cut the power of the robot's machine and start it again."""
    simulation.robot.kill()
    simulation.robot.disk.cut_power(event.salt)
    restart_robot(simulation, int(event.arguments[0]))


def apply_rot(simulation: Simulation, event: Event) -> None:
    """Damage a file while the robot does not run."""
    name, back_ms = str(event.arguments[0]), int(event.arguments[1])
    simulation.robot.kill()
    if simulation.robot.disk.damage(f"{name}.json"):
        simulation.oracle.keeping.damaged(name)
    restart_robot(simulation, back_ms)


# Clocks.


def apply_sleep(simulation: Simulation, event: Event) -> None:
    """Suspend an operator's machine, and its clock with it; one that stands sleeps no deeper."""
    name, for_ms = str(event.arguments[0]), int(event.arguments[1])
    if simulation.host(name).suspended:
        return
    apply_suspend(simulation, event)
    until_ns = simulation.scheduler.now_ns + for_ms * NS_PER_MS
    simulation.scheduler.at(until_ns - 1, step, simulation, name, -for_ms * NS_PER_MS)


def draw_clock(random: Random) -> Arguments:
    """Draw a process and the step of its clock in ms."""
    step_ms = random.choice((50, 200, 1000, 5000, 3_600_000))
    return random.choice(("robot", "plant", *OPERATORS)), step_ms


def apply_clock(simulation: Simulation, event: Event) -> None:
    """Let a machine's clock jump ahead, as after its virtual machine was moved."""
    name, step_ms = str(event.arguments[0]), int(event.arguments[1])
    step(simulation, name, step_ms * NS_PER_MS)
    if name in ("robot", "plant"):
        simulation.oracle.facts.held_up(simulation.scheduler.now_ns + 500 * NS_PER_MS)


def step(simulation: Simulation, name: str, by_ns: int) -> None:
    """Step a clock; operators do not know the robot's clock until they measure it again."""
    facts, now_ns = simulation.oracle.facts, simulation.scheduler.now_ns
    simulation.host(name).clock_offset_ns += by_ns
    if name == "robot":
        simulation.robot.clock_offset_ns += by_ns
    facts.unsure(max(now_ns, facts.sound_since_ns) + MEASURED_NS)


def apply_wall_clock(simulation: Simulation, event: Event) -> None:
    """Set the robot's wall clock; its monotonic clock continues."""
    by_ns = int(event.arguments[0]) * 1000 * NS_PER_MS
    simulation.robot.wall_step_ns += by_ns
    simulation.robot.host.wall_offset_ns += by_ns


# Attacks.


def draw_attack(random: Random) -> Arguments:
    """Draw a kind of attack, how often it is repeated and with which gap in ms."""
    kind = random.choice((*ATTACKS, "known stops", "known stops", "orders", "orders"))
    if kind == "known stops":  # only as a flood: a single one has no effect
        return kind, random.choice((50, 200)), random.choice((0, 1, 5))
    if kind == "orders":  # slowly enough that each is answered
        return kind, random.choice((20, 60)), random.choice((20, 60))
    if kind == "wheels":
        return (
            kind,
            random.choice((1, 1, 5, 40)),
            random.choice((0, 7, 50)),
            random.choice((0, 0, -1, -4, 3, 1000, 1 << 32)),
            random.choice((9000, 1 << 30, -9000, 0)),
            random.choice((0, 150, 65_535)),
        )
    return kind, random.choice((1, 5, 50, 200)), random.choice((0, 1, 5, 20, 100))


def apply_attack(simulation: Simulation, event: Event) -> None:
    """Begin an attack."""
    kind, count, gap_ms, *more = event.arguments
    simulation.attacker.attack(str(kind), int(count), int(gap_ms), event.salt, tuple(more))


# Operators.


def apply_operate(simulation: Simulation, event: Event) -> None:
    """Let an operator act."""
    name, action, *arguments = event.arguments
    simulation.operators[str(name)].do(str(action), tuple(arguments))


def apply_client(simulation: Simulation, event: Event) -> None:
    """Let a client of the gateway act."""
    name, action, *arguments = event.arguments
    simulation.clients[str(name)].do(str(action), tuple(arguments))


def draw_crossing(random: Random) -> Arguments:
    """Draw who clears a stop, who presses one meanwhile, and how many ms later."""
    return (*random.sample(OPERATORS[:3], 2), random.choice((1, 3, 10, 20, 40)))


def apply_crossing(simulation: Simulation, event: Event) -> None:
    """Let an operator clear the stop and another press it, within one tick of the robot."""
    first, second, gap_ms = event.arguments
    clears, presses = simulation.operators[str(first)], simulation.operators[str(second)]
    presses.start()
    clears.start()
    clears.do("order", ("clear-estop",))
    after(simulation, int(gap_ms), presses.do, "stop", ())


def apply_come(simulation: Simulation, event: Event) -> None:
    """Start an operator that takes the lease or only sends heartbeats."""
    name, lease = str(event.arguments[0]), int(event.arguments[1])
    operator = simulation.operators[name]
    operator.start()
    operator.beating = True
    if lease:
        operator.do("lease", ("TAKE",))


def apply_leave(simulation: Simulation, event: Event) -> None:
    """Kill an operator's process for good."""
    simulation.operators[str(event.arguments[0])].kill()


FAULTS: Final[Mapping[str, ScenarioEventKind]] = MappingProxyType(
    {
        "come": ScenarioEventKind(0, lambda r: (r.choice(OPERATORS), r.randrange(2)), apply_come),
        "operate": ScenarioEventKind(0, draw_operate, apply_operate),
        "leave": ScenarioEventKind(2, lambda r: (r.choice(OPERATORS),), apply_leave),
        "rough": ScenarioEventKind(8, draw_rough, apply_rough),
        "queue": ScenarioEventKind(
            5,
            lambda r: (*pair(r), r.choice((0.2, 0.5, 0.8)), r.choice((2000, 4000, 8000))),
            apply_queue,
        ),
        "cut": ScenarioEventKind(6, lambda r: (*pair(r), r.randrange(2), span_ms(r)), apply_cut),
        "kill": ScenarioEventKind(4, draw_kill, apply_kill),
        "suspend": ScenarioEventKind(4, lambda r: (r.choice(HOSTS), span_ms(r)), apply_suspend),
        "hang": ScenarioEventKind(3, lambda r: (span_ms(r),), apply_hang),
        "busy": ScenarioEventKind(
            2, lambda r: (r.choice((5, 15, 30, 60, 90)), span_ms(r)), apply_busy
        ),
        "slow disk": ScenarioEventKind(
            2, lambda r: (r.choice((30, 100, 250, 1000)), span_ms(r) * 4), apply_slow_disk
        ),
        "failing disk": ScenarioEventKind(1, lambda r: (span_ms(r) * 2,), apply_failing_disk),
        "rot": ScenarioEventKind(
            2, lambda r: (r.choice(("fence", "fence", "mission", "parameters")), 300), apply_rot
        ),
        "sleep": ScenarioEventKind(2, lambda r: (r.choice(OPERATORS), span_ms(r)), apply_sleep),
        "clock": ScenarioEventKind(2, draw_clock, apply_clock),
        "wall clock": ScenarioEventKind(
            1, lambda r: (r.choice((-86_400, -5, 5, 86_400)),), apply_wall_clock
        ),
        "attack": ScenarioEventKind(6, draw_attack, apply_attack),
        "crossing": ScenarioEventKind(2, draw_crossing, apply_crossing),
        "restart": ScenarioEventKind(2, draw_restart, apply_restart),
        "link": ScenarioEventKind(0, draw_link, apply_link),
        "stand": ScenarioEventKind(0, lambda r: (r.choice((1500, 2500, 4000)),), apply_stand),
        "power cut": ScenarioEventKind(2, lambda r: (r.choice((100, 500, 2000)),), apply_power_cut),
        "gateway": ScenarioEventKind(0, lambda _: (), lambda run, _: run.start_gateway()),
        "client": ScenarioEventKind(0, draw_client, apply_client),
    }
)
