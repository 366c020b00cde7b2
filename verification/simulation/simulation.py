"""One run: a scenario in, a violation or none out, and a digest that is the same each time."""

import gc
from contextlib import nullcontext
from random import Random
from typing import Final, NamedTuple

from robot.core import states
from robot.core.values import Pose
from runtime.units import NS_PER_MS
from verification.simulation.actions import OPERATORS, STATION
from verification.simulation.coverage import Coverage
from verification.simulation.defects import defective
from verification.simulation.events import Event, Scenario
from verification.simulation.hosts import robot_side
from verification.simulation.hosts.attacker import MINE, Attacker
from verification.simulation.hosts.hub import Hub, Sample, path_of
from verification.simulation.hosts.network import Network
from verification.simulation.hosts.operators import History, Operator
from verification.simulation.hosts.plant_side import WORLDS, PlantSide
from verification.simulation.hosts.robot_side import RobotSide
from verification.simulation.hosts.scheduler import Host, Scheduler
from verification.simulation.hosts.session import Session
from verification.simulation.hosts.station_side import StationOperator
from verification.simulation.hosts.substitutes import Drawn, Opened, substituted
from verification.simulation.invariants.oracle import Oracle
from verification.simulation.invariants.shared import Violation

LIES_NS: Final = 15_000 * NS_PER_MS
"""For so long after a time that is not true the robot may be wrong about its sender."""

NAVIGATORS: Final = (states.BUG, states.VGM, states.BUG2)


class Result(NamedTuple):
    """How a run ended."""

    scenario: Scenario
    violation: Violation | None
    digest: str
    simulated_ns: int
    coverage: Coverage


class Simulation:
    """All processes of one run; faults and operators act on it by the events of the scenario."""

    def __init__(self, scenario: Scenario) -> None:
        random = Random(f"setting {scenario.seed}")
        self.scenario = scenario
        self.scheduler = scheduler = Scheduler()
        self.network = Network(scheduler)
        self.hub = Hub(self.network)
        self.history = History()
        self.oracle = Oracle(scheduler, self.history)
        self._zids = Random(f"zids {scenario.seed}")
        world = WORLDS[0] if random.random() < 0.8 else WORLDS[1]
        params = robot_side.robot_params(random.choice(NAVIGATORS))
        start = Pose(world.start.x_m, world.start.y_m, world.start.heading_rad)
        self.world = world
        self.robot = RobotSide(scheduler, "robot", params, start, self.oracle)
        self.robot.clock_offset_ns = random.randrange(1, 10**14)
        self.plant = PlantSide(
            scheduler, "plant", world, self.oracle.plant_tick, self.oracle.plant_started
        )
        self.operators = {
            name: (StationOperator if name == STATION else Operator)(scheduler, name, self.history)
            for name in OPERATORS
        }
        for operator in self.operators.values():
            operator.centre = (start.x_m, start.y_m)
        facts = self.oracle.facts
        facts.robot = self.robot
        self.attacker = Attacker(
            scheduler, self.hub, lambda: self.robot.host.now_ns(), lambda: facts.plant_ns, self.lie
        )
        self.hub.taps.append(self._tap)
        self.hub.arrivals.append(self._arrived)
        self._zid_of: dict[str, str] = {}

    def run(self) -> Result:
        """Run to the end of the scenario or to the first violation."""
        scenario, scheduler = self.scenario, self.scheduler
        draw = Random(f"secrets {scenario.seed}").getrandbits
        Drawn.draw = lambda bits: draw(bits) or 1
        Opened.open = self._session
        self.start_robot()
        self.plant.start()
        for event in scenario.events:
            scheduler.at(event.time_ns, self.apply, event)
        step_ns = 50 * NS_PER_MS
        try:
            for now_ns in range(step_ns, scenario.duration_ns + 1, step_ns):
                scheduler.run(now_ns)
                self._judge()
                if self.oracle.facts.violation is not None:
                    break
        finally:
            self._close()
        return Result(
            scenario,
            self.oracle.facts.violation,
            self.oracle.digest.hexdigest(),
            scheduler.now_ns,
            self.oracle.facts.coverage,
        )

    def apply(self, event: Event) -> None:
        """Have something happen."""
        from verification.simulation.faults import FAULTS

        FAULTS[event.kind].apply(self, event)

    # What events do.

    def start_robot(self) -> None:
        self.oracle.robot_started()
        self.robot.start()

    def operator(self, name: str) -> Operator:
        return self.operators[name]

    def host(self, name: str) -> Host:
        if name == "robot":
            return self.robot.host
        if name == "plant":
            return self.plant.host
        return self.operators[name].host if name in self.operators else self.attacker.host

    def lie(self) -> None:
        """An operator's frames carry times that are not true."""
        self.oracle.presence.lies_until_ns = self.scheduler.now_ns + LIES_NS

    # What is looked at.

    def _session(self, _network: object) -> Session:
        zid = f"{self._zids.getrandbits(124) + 1:032x}"
        session = Session(self.hub, zid)
        self._zid_of[session.host.name] = f"open/{zid}"
        return session

    def _tap(self, source: Host, key: str, frame: bytes, note: bytes | None, asked: bool) -> None:
        if source is not self.attacker.host:
            self.attacker.hear(key, frame, note, asked=asked)
        if not asked:
            self.oracle.put(source, path_of(key), frame)

    def _arrived(self, sample: Sample) -> None:
        """What an operator has sent under its own name is at the robot."""
        source, path = sample.source, path_of(sample.key_expr)
        mine = MINE if source is self.attacker.host else self._zid_of.get(source.name, "")
        if path.endswith(f"/{mine}"):
            self.oracle.presence.arrived(path, sample.payload, sample.sent_ns)

    def _judge(self) -> None:
        hosts = [operator.host for operator in self.operators.values()]
        self.oracle.look([self.robot.host, self.plant.host, self.attacker.host, *hosts])

    def _close(self) -> None:
        """End all processes without a word."""
        for operator in self.operators.values():
            operator.kill()
        self.robot.kill()
        self.plant.kill()


def run(scenario: Scenario, defect: str = "") -> Result:
    """Run a scenario; everything that blocks is simulated meanwhile.

    With `defect` one that was mended is put back: the name of a row of `defects.DEFECTS`.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        with substituted(), defective(defect) if defect else nullcontext():
            return Simulation(scenario).run()
    finally:
        if collects:
            gc.enable()
