"""A world with robots in it, simulated one control period at a time."""

from collections.abc import Iterable
from math import sqrt
from typing import Final

from plant.model.body import Body
from plant.model.configuration import body_of, faults_of
from plant.model.faults import Fault
from plant.model.movers import Mover
from plant.model.noise import Noise
from plant.model.scene import Disc, movers, still
from plant.model.types import World
from plant.placement.start_positions import starts
from plant.sim.physics import Arena
from plant.sim.simulated_robot import PERIOD_S, Moved, SharedSetup, SimulatedRobot
from protocol.wire.messages import GroundTruth, RunScore, SonarScan, WheelTicks
from runtime.timing import PERIOD_NS
from runtime.units import NS_PER_S

SUBSTEPS: Final = 2
SUBSTEP_NS: Final = PERIOD_NS // SUBSTEPS
SUBSTEP_S: Final = PERIOD_S / SUBSTEPS
MARGIN_M: Final = 0.005


class Plant:
    """World and robots. Tick 0 exists before anything moves; `advance` leads to the next tick."""

    def __init__(
        self,
        world: World,
        seed: int,
        noise: Noise,
        faults: Iterable[Fault] = (),
        robots: int = 1,
        at_ns: int = 0,
    ) -> None:
        """Create the plant at time `at_ns`, a multiple of the period.

        `faults` are added to those of the world. Raises ValueError if a fault names a missing robot
        or a start is not free.
        """
        self.world = world
        self.seed = seed
        self.noise = noise
        self.body = body_of(world)
        self.now_ns = at_ns
        self._movers = [Mover(circle) for circle in movers(world)]
        self._mover_speed_m_s = max((mover.speed_m_s for mover in self._movers), default=0.0)
        self._early_discs = self._discs = self._discs_at(at_ns)
        self._arena = Arena(world, self.body.radius_m, [disc[:2] for disc in self._discs])
        common = SharedSetup(self.body, noise, seed, still(world), self._arena)
        every = (*faults_of(world), *faults)
        for fault in every:
            _check_robot(fault, robots)
        self._vehicles = [
            SimulatedRobot(
                common, number, start, [fault for fault in every if fault.robot == number]
            )
            for number, start in enumerate(starts(world, self.body, robots))
        ]
        self._alone = robots == 1 and not self._movers
        self._close_m = _close_m(self.body, noise, self._mover_speed_m_s, robots)
        self.restart_score()
        self._sense()

    def senses(self, robot: int = 0) -> tuple[WheelTicks | None, SonarScan | None]:
        """Return a robot's sensor data at this tick; None for a message that a fault suppresses."""
        return self._vehicles[robot].senses

    def truth(self, robot: int = 0) -> GroundTruth:
        """Return the true pose and velocity of a robot."""
        return self._vehicles[robot].truth(self.now_ns)

    def attitude(self, robot: int = 0) -> tuple[float, float]:
        """Return true heading and clearance, which are cheap to read in every tick."""
        vehicle = self._vehicles[robot]
        return vehicle.pose[2], vehicle.clearance_m

    def command(self, robot: int, left_mrad_s: int, right_mrad_s: int, ttl_ms: int) -> None:
        """Set the wheel speeds from now on, for `ttl_ms` of simulated time."""
        self._vehicles[robot].drive.command(left_mrad_s, right_mrad_s, ttl_ms, self.now_ns)

    def advance(self) -> None:
        """Advance by one control period."""
        vehicles = self._vehicles
        close = False
        for vehicle in vehicles:
            close |= vehicle.clearance_m < self._close_m
            vehicle.begin_tick()
        self._substep(self.now_ns, close)
        for vehicle in vehicles:
            vehicle.halfway()
        self._early_discs = self._discs
        self._substep(self.now_ns + SUBSTEP_NS, close)
        self.now_ns += PERIOD_NS
        for vehicle in vehicles:
            vehicle.end_tick()
        self._sense()

    def score(self, until_ns: int, robot: int = 0) -> RunScore:
        """Return the score since its restart, up to the tick at `until_ns`."""
        return self._vehicles[robot].score.until(until_ns)

    def restart_score(self) -> None:
        """Begin a new score for all robots."""
        for vehicle in self._vehicles:
            vehicle.restart_score(self.now_ns)

    def inject(self, fault: Fault) -> None:
        """Add a fault from the next period on.

        Raises ValueError if it names a missing robot.
        """
        _check_robot(fault, len(self._vehicles))
        self._vehicles[fault.robot].faults.add(fault)

    def clear_faults(self) -> None:
        """Drop all faults."""
        for vehicle in self._vehicles:
            vehicle.faults.clear(self.now_ns)

    def _substep(self, now_ns: int, close: bool) -> None:
        if self._alone and not close:
            self._vehicles[0].coast(now_ns, SUBSTEP_S)
            return
        speeds_m_s = sorted([vehicle.set_off(now_ns, SUBSTEP_S) for vehicle in self._vehicles])
        if self._movers:
            self._carry(now_ns)
        fastest_m_s = speeds_m_s[-1] + (speeds_m_s[-2] if len(speeds_m_s) > 1 else 0.0)
        closing_m_s = fastest_m_s + self._mover_speed_m_s
        self._arena.step(SUBSTEP_S, closing_m_s if close else 0.0)
        for vehicle in self._vehicles:
            vehicle.arrive(close)

    def _carry(self, now_ns: int) -> None:
        """Move the moving obstacles by one substep."""
        before, self._discs = self._discs, self._discs_at(now_ns + SUBSTEP_NS)
        for index, (old, new) in enumerate(zip(before, self._discs, strict=True)):
            x_m_s, y_m_s = (new[0] - old[0]) / SUBSTEP_S, (new[1] - old[1]) / SUBSTEP_S
            self._arena.carry(index, old[:2], x_m_s, y_m_s)

    def _discs_at(self, now_ns: int) -> list[Disc]:
        return [(*mover.position_m(now_ns / NS_PER_S), mover.radius_m) for mover in self._movers]

    def _sense(self) -> None:
        for vehicle in self._vehicles:
            vehicle.sense(self.now_ns, self._moved(vehicle))

    def _moved(self, seer: SimulatedRobot) -> Moved:
        """Return the moving objects visible to a robot, at its early and at its late pings."""
        if len(self._vehicles) == 1:
            return self._early_discs, self._discs
        radius_m = self.body.radius_m
        others = [vehicle for vehicle in self._vehicles if vehicle is not seer]
        early = [(*vehicle.early_pose[:2], radius_m) for vehicle in others]
        late = [(*vehicle.pose[:2], radius_m) for vehicle in others]
        return [*self._early_discs, *early], [*self._discs, *late]


def _check_robot(fault: Fault, robots: int) -> None:
    if fault.robot >= robots:
        raise ValueError(f"robot: {fault.robot} has a fault, but there are only {robots} robots")


def _close_m(body: Body, noise: Noise, mover_speed_m_s: float, robots: int) -> float:
    """Return the clearance below which a contact is possible within one period."""
    way_m = body.max_speed_m_s * PERIOD_S * (1.0 + abs(noise.diameter_difference_ratio))
    way_m += 10.0 * sqrt(noise.slip_variance_m * way_m)
    return MARGIN_M + way_m * (2.0 if robots > 1 else 1.0) + mover_speed_m_s * PERIOD_S
