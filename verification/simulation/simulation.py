"""One run: a scenario in, a violation or none out, and a digest that is the same each time."""

import gc
from random import Random
from typing import Final, NamedTuple

from plant.plant import Plant
from robot.core import states
from robot.core.values import Pose
from verification.simulation import robot_side
from verification.simulation.coverage import Coverage
from verification.simulation.events import Event, Scenario
from verification.simulation.hub import Hub
from verification.simulation.invariants import Oracle, Violation
from verification.simulation.network import Network
from verification.simulation.operators import History, Operator
from verification.simulation.plant_side import WORLDS, PlantSide
from verification.simulation.robot_side import RobotSide
from verification.simulation.scheduler import Host, Scheduler
from verification.simulation.session import Session
from verification.simulation.substitutes import Drawn, Opened, substituted

MS: Final = 1_000_000
OPERATORS: Final = ("operator-a", "operator-b")
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
        self.plant = PlantSide(scheduler, "plant", world, self._look)
        self.operators = {name: Operator(scheduler, name, self.history) for name in OPERATORS}
        for operator in self.operators.values():
            operator.centre = (start.x_m, start.y_m)
        self.attacker = Host(scheduler, "attacker")
        self.oracle.robot = self.robot
        self.hub.taps.append(self.oracle.put)
        self._told = 0
        self._over = False

    def run(self) -> Result:
        """Run to the end of the scenario or to the first violation."""
        scenario, scheduler = self.scenario, self.scheduler
        draw = Random(f"secrets {scenario.seed}").getrandbits
        Drawn.draw = lambda bits: draw(bits) or 1
        Opened.open = lambda _network: Session(self.hub, f"{self._zids.getrandbits(124) + 1:032x}")
        self.start_robot()
        self.plant.start()
        for event in scenario.events:
            scheduler.at(event.time_ns, self.apply, event)
        step_ns = 50 * MS
        try:
            for now_ns in range(step_ns, scenario.duration_ns + 1, step_ns):
                scheduler.run(now_ns)
                self._judge()
                if self.oracle.violation is not None:
                    break
        finally:
            self._close()
        return Result(
            scenario,
            self.oracle.violation,
            self.oracle.digest.hexdigest(),
            scheduler.now_ns,
            self.oracle.coverage,
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
        return self.operators[name].host if name in self.operators else self.attacker

    # What is looked at.

    def _look(self, plant: Plant) -> None:
        self.oracle.plant_tick(plant)

    def _judge(self) -> None:
        asked = self.history.asked
        for one in asked[self._told :]:
            if one.ended_ns is None:
                break
            self.oracle.told(one)
            self._told += 1
        for host in (self.robot.host, self.plant.host, *[o.host for o in self.operators.values()]):
            if host.error is not None:
                self.oracle.ended(host)

    def _close(self) -> None:
        """End all processes without a word."""
        for operator in self.operators.values():
            operator.kill()
        self.robot.kill()
        self.plant.kill()


def run(scenario: Scenario) -> Result:
    """Run a scenario; everything that blocks is simulated meanwhile."""
    collects = gc.isenabled()
    gc.disable()
    try:
        with substituted():
            return Simulation(scenario).run()
    finally:
        if collects:
            gc.enable()
