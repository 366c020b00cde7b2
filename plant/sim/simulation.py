"""A world with robots in it, simulated one control period at a time.

Each robot has its true pose, drive and sensors, and is scored from ground truth.
"""

from array import array
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from math import pi, sqrt
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np

from plant.model.configuration import Body, Fault, Noise, body_of, faults_of
from plant.model.geometry import Disc, Pose, StaticScene, movers, still
from plant.placement import starts
from plant.sim.active_faults import FaultSchedule
from plant.sim.drive import DifferentialDrive
from plant.sim.physics import Arena, MovingDisc
from plant.sim.sonar import PING_AGE_US, Caster, SimulatedSonarRing
from protocol.wire.enums import BUMPER_LEFT, BUMPER_REAR, BUMPER_RIGHT
from protocol.wire.messages import GroundTruth, RunScore, SonarScan, WheelTicks
from protocol.world import Point, World
from runtime.elementary import atan2, cos_sin, hypot, sin
from runtime.units import NS_PER_S, PERIOD_NS, PERIOD_S, UINT32

if TYPE_CHECKING:
    from hashlib import _Hash


MAX_TICKS: Final = 1_000_000
COLUMNS: Final = 5
HASHED: Final = 4096
"""Ticks between kept states of the hash; limits the cost of a digest."""

_SIGNED: Final = np.dtype([("time_ns", "<u8"), ("pose", "<f8", 3)])


class Score:
    """The trajectory since the start, one row per tick, up to a million ticks (14 hours).

    After that the score stops: `RunScore.ticks` stays constant.
    """

    def __init__(
        self, start_ns: int, x_m: float, y_m: float, heading_rad: float, clearance_m: float
    ) -> None:
        self._start_ns = start_ns
        self._rows = array("d", (x_m, y_m, heading_rad, 0.0, clearance_m))
        self._x_m, self._y_m, self._path_m, self._least_m = x_m, y_m, 0.0, clearance_m
        self._contacts = array("L", (0,))
        self._own_contacts = array("L", (0,))
        self._touching = False
        self._hashes = [sha256()]

    @property
    def ticks(self) -> int:
        """The number of ticks scored."""
        return len(self._contacts) - 1

    def add(
        self,
        x_m: float,
        y_m: float,
        heading_rad: float,
        clearance_m: float,
        touching: bool,
        closing: bool = False,
    ) -> None:
        """Add a tick; `closing`: the robot itself moved towards the obstacle it touches."""
        if len(self._contacts) > MAX_TICKS:
            return
        self._path_m += hypot(x_m - self._x_m, y_m - self._y_m)
        self._x_m, self._y_m = x_m, y_m
        if clearance_m < self._least_m:
            self._least_m = clearance_m
        self._rows.extend((x_m, y_m, heading_rad, self._path_m, self._least_m))
        begun = touching and not self._touching
        self._contacts.append(self._contacts[-1] + begun)
        self._own_contacts.append(self._own_contacts[-1] + (begun and closing))
        self._touching = touching
        if not self.ticks % HASHED:
            self._hashes.append(self._hash(self.ticks - HASHED, self.ticks))

    def until(self, until_ns: int) -> RunScore:
        """Return the score from the first tick to the one at `until_ns`, or to the newest."""
        ticks = max(0, min(self.ticks, (until_ns - self._start_ns) // PERIOD_NS))
        row = self._rows[ticks * COLUMNS : (ticks + 1) * COLUMNS]
        x_m, y_m, heading_rad, path_m, clearance_m = row.tolist()
        return RunScore(
            time_ns=self._start_ns + ticks * PERIOD_NS,
            ticks=ticks,
            contacts=self._contacts[ticks],
            own_contacts=self._own_contacts[ticks],
            x_m=x_m,
            y_m=y_m,
            heading_rad=heading_rad,
            path_m=path_m,
            min_clearance_m=clearance_m,
            digest=tuple(self._hash(ticks - ticks % HASHED, ticks).digest()),
        )

    def _hash(self, kept: int, ticks: int) -> "_Hash":
        """Return the hash up to a tick, from the state kept at an earlier tick."""
        hashed = self._hashes[kept // HASHED].copy()
        signed = np.empty(ticks - kept, dtype=_SIGNED)
        stamps = np.arange(kept + 1, ticks + 1, dtype=np.uint64) * np.uint64(PERIOD_NS)
        signed["time_ns"] = stamps + np.uint64(self._start_ns)
        rows = self._rows[(kept + 1) * COLUMNS : (ticks + 1) * COLUMNS]
        signed["pose"] = np.array(rows).reshape(-1, COLUMNS)[:, :3]
        hashed.update(signed.tobytes())
        return hashed


OVERLAP_RAD: Final = 0.175
"""Overlap of the two front sectors of the bumper beyond the middle."""
REAR_RAD: Final = 2.0 * pi / 3.0

CLOSING_M_S: Final = 0.01
"""Speed towards a touched object above which the robot has caused the contact, because it would
have touched a static object, too. Turning on the spot never brings a disc closer."""


Moved: TypeAlias = tuple[Sequence[Disc], Sequence[Disc]]


Leg: TypeAlias = tuple[float, float, float]
"""Velocity x_m_s, y_m_s of a robot in one substep as long as nothing stops it, and its amount."""


class RobotMotion(NamedTuple):
    """What the world must know of a robot to move it by one period: where it is, and both legs.

    Neither the wheels nor the heading depend on contacts, so the legs are known before the world
    moves.
    """

    x_m: float
    y_m: float
    clearance_m: float
    legs: tuple[Leg, Leg]


NO_OTHERS: Final[Mapping[int, RobotMotion]] = MappingProxyType({})


class SharedSetup(NamedTuple):
    """Objects shared by the robots of one plant."""

    body: Body
    noise: Noise
    seed: int
    scene: StaticScene
    arena: Arena


class SimulatedRobot:
    """Move in two substeps, then sense, once per tick."""

    def __init__(
        self, common: SharedSetup, number: int, start: Pose, faults: Iterable[Fault]
    ) -> None:
        body, noise, seed, scene, self._arena = common
        self.faults = FaultSchedule(faults)
        self.drive = DifferentialDrive(body, noise, seed, number)
        self._ring = SimulatedSonarRing(body, noise, seed, number)
        self._caster = Caster(scene, body.sonar_max_m + body.radius_m, noise.incidence_limit_rad)
        self._track_m = body.track_m
        self._robot = number
        self.pose = self.early_pose = self._before = start
        self._turned_rad = self._turning_rad = 0.0
        self._headings_rad = (start[2], start[2])
        self._step = 0
        self.legs: tuple[Leg, Leg] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._touched = 0
        self._closing = self._coasted = False
        self.bumper = 0
        self.clearance_m = 0.0
        self.score = Score(0, *start, 0.0)
        self.senses: tuple[WheelTicks | None, SonarScan | None] = (None, None)

    def run_wheels(self, now_ns: int) -> None:
        """Run the wheels for both substeps of a period, which sets the legs."""
        self._turning_rad = 0.0
        early, early_rad = self._roll(now_ns, self.pose[2])
        late, late_rad = self._roll(now_ns + SUBSTEP_NS, early_rad)
        self.legs, self._headings_rad = (early, late), (early_rad, late_rad)

    def coast(self, step: int) -> None:
        """Move a whole substep without obstacles near; bit-identical to the arena's result."""
        (x_m, y_m, _), (x_m_s, y_m_s, _) = self.pose, self.legs[step]
        self._step, self._coasted = step, True
        self.pose = (x_m + x_m_s * SUBSTEP_S, y_m + y_m_s * SUBSTEP_S, self._headings_rad[step])

    def set_off(self, step: int) -> float:
        """Push the robot for a substep; return its speed."""
        x_m_s, y_m_s, speed_m_s = self.legs[step]
        self._step = step
        if self._coasted:
            self._arena.place(self._robot, *self.pose[:2])
            self._coasted = False
        self._arena.push(self._robot, x_m_s, y_m_s)
        return speed_m_s

    def _roll(self, now_ns: int, heading_rad: float) -> tuple[Leg, float]:
        """Return a substep's motion along the chord of the wheels' arc, and the heading then."""
        left_m, right_m = self.drive.roll(now_ns, SUBSTEP_S, self.faults.at(now_ns))
        half_rad = (right_m - left_m) / self._track_m / 2.0
        speed_m_s = (left_m + right_m) / 2.0 / SUBSTEP_S
        if half_rad:
            speed_m_s *= sin(half_rad) / half_rad
        cosine, sine = cos_sin(heading_rad + half_rad)
        turn_rad = 2.0 * half_rad
        self._turning_rad += turn_rad
        heading_rad += turn_rad
        if not -pi <= heading_rad <= pi:
            heading_rad -= 2.0 * pi if heading_rad > 0.0 else -2.0 * pi
        return (speed_m_s * cosine, speed_m_s * sine, abs(speed_m_s)), heading_rad

    def arrive(self, close: bool) -> None:
        """Take the result of the substep; `close`: there may be a contact."""
        self.pose = (*self._arena.position_m(self._robot), self._headings_rad[self._step])
        if close:
            self._touch(self._arena.contacts(self._robot))

    def _touch(self, contacts: Sequence[tuple[Point, bool]]) -> None:
        """Press the bumper; decide at the beginning of a contact whether the robot has caused it.

        A robot that drives and comes nearer to a static obstacle has caused the contact, even if it
        only grazes it; a robot that turns on the spot has not.
        """
        x_m_s, y_m_s, _ = self.legs[self._step]
        began, drives = self._touched == 0, hypot(x_m_s, y_m_s) > CLOSING_M_S
        for direction, is_still in contacts:
            self._touched |= _sectors(direction, self.pose[2])
            closing_m_s = x_m_s * direction[0] + y_m_s * direction[1]
            least_m_s = 0.0 if is_still and drives else CLOSING_M_S
            self._closing |= began and closing_m_s > least_m_s

    def halfway(self) -> None:
        """Store the pose at the early pings."""
        self.early_pose = self.pose

    def end_tick(self) -> None:
        """Add the tick to the score."""
        self.bumper, self._touched = self._touched, 0
        closing, self._closing = self._closing, False
        x_m, y_m, heading_rad = self.pose
        self.clearance_m = clearance_m = self._arena.clearance_m(self._robot, (x_m, y_m))
        self.score.add(x_m, y_m, heading_rad, clearance_m, self.bumper != 0, closing)

    def begin_tick(self) -> None:
        """Store the pose before the tick."""
        self._before, self._turned_rad = self.pose, self._turning_rad

    def restart_score(self, now_ns: int) -> None:
        """Begin a new score."""
        self.clearance_m = self._arena.clearance_m(self._robot, self.pose[:2])
        self.score = Score(now_ns, *self.pose, self.clearance_m)

    def sense(self, now_ns: int, moved: Moved) -> None:
        """Compute the sensor data of this tick; `moved`: see `Caster.cast`."""
        trouble = self.faults.at(now_ns)
        seq = (now_ns // PERIOD_NS) & UINT32
        nearness = self._caster.cast(self.early_pose, self.pose, moved)
        range_mm, valid, echo = self._ring.read(nearness, trouble.sonar)
        left, right = self.drive.ticks(trouble.jumped_ticks)
        ticks = WheelTicks(
            time_ns=now_ns,
            seq=seq,
            left=left,
            right=right,
            bumper=self.bumper | trouble.bumper,
            expired=int(self.drive.expired),
        )
        scan = SonarScan(
            time_ns=now_ns,
            seq=seq,
            range_mm=range_mm,
            ping_age_us=PING_AGE_US,
            valid=valid,
            echo=echo,
        )
        self.senses = (
            None if trouble.ticks_stopped else ticks,
            None if trouble.scan_stopped else scan,
        )

    def truth(self, now_ns: int) -> GroundTruth:
        """Return the true pose and velocity."""
        x_m, y_m, heading_rad = self.pose
        cosine, sine = cos_sin(self.early_pose[2])
        way_x_m, way_y_m = x_m - self._before[0], y_m - self._before[1]
        return GroundTruth(
            time_ns=now_ns,
            seq=(now_ns // PERIOD_NS) & UINT32,
            x_m=x_m,
            y_m=y_m,
            heading_rad=heading_rad,
            speed_m_s=(way_x_m * cosine + way_y_m * sine) / PERIOD_S,
            yaw_rate_rad_s=self._turned_rad / PERIOD_S,
            clearance_m=self.clearance_m,
            contact=int(self.bumper != 0),
        )


def _sectors(direction: Point, heading_rad: float) -> int:
    """Return the bumper sectors that a contact in a direction presses."""
    bearing_rad = (atan2(direction[1], direction[0]) - heading_rad + pi) % (2.0 * pi) - pi
    if abs(bearing_rad) > REAR_RAD:
        return BUMPER_REAR
    left = BUMPER_LEFT if bearing_rad > -OVERLAP_RAD else 0
    return left | (BUMPER_RIGHT if bearing_rad < OVERLAP_RAD else 0)


SUBSTEPS: Final = 2
SUBSTEP_NS: Final = PERIOD_NS // SUBSTEPS
SUBSTEP_S: Final = PERIOD_S / SUBSTEPS
MARGIN_M: Final = 0.005


class Plant:
    """World and robots. Tick 0 exists before anything moves; `advance` leads to the next tick.

    Several plants can share a world. Each has the discs of all robots and moves them alike, but
    wheels, senses and score only of its `own`. So it must be told the motions of the others.
    """

    def __init__(
        self,
        world: World,
        seed: int,
        noise: Noise,
        faults: Iterable[Fault] = (),
        robots: int = 1,
        at_ns: int = 0,
        own: Sequence[int] | None = None,
    ) -> None:
        """Create the plant at time `at_ns`, a multiple of the period.

        `faults` are added to those of the world. `own` has the numbers of the robots that this
        plant simulates, by default all. Raises ValueError if a fault names a missing robot
        or a start is not free.
        """
        self.world = world
        self.seed = seed
        self.noise = noise
        self.body = body_of(world)
        self.now_ns = at_ns
        self._movers = [MovingDisc(circle) for circle in movers(world)]
        self._mover_speed_m_s = max((mover.speed_m_s for mover in self._movers), default=0.0)
        self._early_discs = self._discs = self._discs_at(at_ns)
        at = [disc[:2] for disc in self._discs]
        self._arena = Arena(world, self.body.radius_m, at, self.body.sonar_max_m)
        common = SharedSetup(self.body, noise, seed, still(world), self._arena)
        every = (*faults_of(world), *faults)
        for fault in every:
            _check_robot(fault, robots)
        places = starts(world, self.body, robots)
        for x_m, y_m, _ in places:
            self._arena.add_robot(x_m, y_m)
        self._of = {
            number: SimulatedRobot(
                common, number, places[number], [one for one in every if one.robot == number]
            )
            for number in (range(robots) if own is None else own)
        }
        self._vehicles = list(self._of.values())
        self._robots = robots
        self._others = [number for number in range(robots) if number not in self._of]
        self._alone = robots == 1 and not self._movers
        self._close_m = _close_m(self.body, noise, self._mover_speed_m_s, robots)
        self._early_places = self._places = self._arena.places_m()
        self._is_rolled = False
        self.restart_score()
        self._sense()

    def senses(self, robot: int = 0) -> tuple[WheelTicks | None, SonarScan | None]:
        """Return a robot's sensor data at this tick; None for a message that a fault suppresses."""
        return self._of[robot].senses

    def truth(self, robot: int = 0) -> GroundTruth:
        """Return the true pose and velocity of a robot."""
        return self._of[robot].truth(self.now_ns)

    def attitude(self, robot: int = 0) -> tuple[float, float]:
        """Return true heading and clearance, which are cheap to read in every tick."""
        vehicle = self._of[robot]
        return vehicle.pose[2], vehicle.clearance_m

    def command(self, robot: int, left_mrad_s: int, right_mrad_s: int, ttl_ms: int) -> None:
        """Set the wheel speeds from now on, for `ttl_ms` of simulated time."""
        self._of[robot].drive.command(left_mrad_s, right_mrad_s, ttl_ms, self.now_ns)

    def motions(self) -> dict[int, RobotMotion]:
        """Run the wheels of the own robots for the next period; return how they will move."""
        if not self._is_rolled:
            self._is_rolled = True
            for vehicle in self._vehicles:
                vehicle.run_wheels(self.now_ns)
        return {
            number: RobotMotion(*vehicle.pose[:2], vehicle.clearance_m, vehicle.legs)
            for number, vehicle in self._of.items()
        }

    def advance(self, others: Mapping[int, RobotMotion] = NO_OTHERS) -> None:
        """Advance by one control period; another plant's robot without a motion stands."""
        vehicles = self._vehicles
        close = False
        for vehicle in vehicles:
            if not self._is_rolled:
                vehicle.run_wheels(self.now_ns)
            close |= vehicle.clearance_m < self._close_m
            vehicle.begin_tick()
        self._is_rolled = False
        for number, other in others.items():
            close |= other.clearance_m < self._close_m
            self._arena.place(number, other.x_m, other.y_m)
        if self._robots > 1:
            self._arena.look_around(self._close_m)
        self._substep(0, others, close)
        for vehicle in vehicles:
            vehicle.halfway()
        self._early_discs, self._early_places = self._discs, self._places
        self._substep(1, others, close)
        self.now_ns += PERIOD_NS
        for vehicle in vehicles:
            vehicle.end_tick()
        self._sense()

    def score(self, until_ns: int, robot: int = 0) -> RunScore:
        """Return the score since its restart, up to the tick at `until_ns`."""
        return self._of[robot].score.until(until_ns)

    def restart_score(self) -> None:
        """Begin a new score for all robots."""
        for vehicle in self._vehicles:
            vehicle.restart_score(self.now_ns)

    def inject(self, fault: Fault) -> None:
        """Add a fault from the next period on.

        Raises ValueError if it names a missing robot.
        """
        _check_robot(fault, self._robots)
        if fault.robot in self._of:
            self._of[fault.robot].faults.add(fault)

    def clear_faults(self) -> None:
        """Drop all faults."""
        for vehicle in self._vehicles:
            vehicle.faults.clear(self.now_ns)

    def _substep(self, step: int, others: Mapping[int, RobotMotion], close: bool) -> None:
        if self._alone and not close:
            self._vehicles[0].coast(step)
            return
        speeds_m_s = [vehicle.set_off(step) for vehicle in self._vehicles]
        for number in self._others:
            other = others.get(number)
            x_m_s, y_m_s, speed_m_s = (0.0, 0.0, 0.0) if other is None else other.legs[step]
            self._arena.push(number, x_m_s, y_m_s)
            speeds_m_s.append(speed_m_s)
        speeds_m_s.sort()
        if self._movers:
            self._carry(self.now_ns + step * SUBSTEP_NS)
        fastest_m_s = speeds_m_s[-1] + (speeds_m_s[-2] if len(speeds_m_s) > 1 else 0.0)
        closing_m_s = fastest_m_s + self._mover_speed_m_s
        self._arena.step(SUBSTEP_S, closing_m_s if close else 0.0)
        for vehicle in self._vehicles:
            vehicle.arrive(close)
        if self._robots > 1:
            self._places = self._arena.places_m()

    def _carry(self, now_ns: int) -> None:
        """Move the moving obstacles by one substep."""
        before, self._discs = self._discs, self._discs_at(now_ns + SUBSTEP_NS)
        for index, (old, new) in enumerate(zip(before, self._discs, strict=True)):
            x_m_s, y_m_s = (new[0] - old[0]) / SUBSTEP_S, (new[1] - old[1]) / SUBSTEP_S
            self._arena.carry(index, old[:2], x_m_s, y_m_s)

    def _discs_at(self, now_ns: int) -> list[Disc]:
        return [(*mover.position_m(now_ns / NS_PER_S), mover.radius_m) for mover in self._movers]

    def _sense(self) -> None:
        for number, vehicle in self._of.items():
            vehicle.sense(self.now_ns, self._moved(number))

    def _moved(self, seer: int) -> Moved:
        """Return the moving objects near a robot, at its early and at its late pings."""
        if self._robots == 1:
            return self._early_discs, self._discs
        radius_m, near = self.body.radius_m, self._arena.neighbours(seer)
        early = [(*self._early_places[number], radius_m) for number in near]
        late = [(*self._places[number], radius_m) for number in near]
        return [*self._early_discs, *early], [*self._discs, *late]


def _check_robot(fault: Fault, robots: int) -> None:
    if fault.robot >= robots:
        raise ValueError(f"robot: {fault.robot} has a fault, but there are only {robots} robots")


def _close_m(body: Body, noise: Noise, mover_speed_m_s: float, robots: int) -> float:
    """Return the clearance below which a contact is possible within one period."""
    way_m = body.max_speed_m_s * PERIOD_S * (1.0 + abs(noise.diameter_difference_ratio))
    way_m += 10.0 * sqrt(noise.slip_variance_m * way_m)
    return MARGIN_M + way_m * (2.0 if robots > 1 else 1.0) + mover_speed_m_s * PERIOD_S
