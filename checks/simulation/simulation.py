"""A run of a scenario: all processes, a violation or none, and a reproducible digest."""

from collections.abc import Callable
from random import Random
from typing import Final, NamedTuple

import zenoh

from checks.simulation.events import OPERATORS, STATION, Event, EventScenario
from checks.simulation.hosts import robot_and_plant
from checks.simulation.hosts.attacker import OWN_NAME, SimulatedAttacker
from checks.simulation.hosts.bus import (
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
from checks.simulation.hosts.virtual_time import Host, Scheduler, current_host
from checks.simulation.invariants.oracle import Oracle
from checks.simulation.invariants.run_state import Coverage, InvariantViolation
from protocol.bus.network import Network
from robot.core import states
from robot.core.values import Pose
from runtime.units import NS_PER_MS

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
    """All processes of a run, on which `apply` lets the events of the scenario act."""

    def __init__(
        self, scenario: EventScenario, apply: Callable[["Simulation", Event], None]
    ) -> None:
        self._apply = apply
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
            scheduler.at(event.time_ns, self._apply, self, event)
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
