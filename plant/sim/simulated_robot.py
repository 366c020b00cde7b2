"""One simulated robot: true pose, drive and sensors."""

from collections.abc import Iterable, Sequence
from math import pi
from typing import Final, NamedTuple, TypeAlias

from plant.model.body import Body
from plant.model.faults import Fault
from plant.model.noise import Noise
from plant.model.scene import Disc, Pose, Scene
from plant.model.types import Point
from plant.sim.active_faults import FaultSchedule
from plant.sim.drive import Drive
from plant.sim.physics import Arena
from plant.sim.score import Score
from plant.sim.sensing.raycast import Caster
from plant.sim.sensing.sonar import PING_AGE_US, Ring
from protocol.wire.enums import BUMPER_LEFT, BUMPER_REAR, BUMPER_RIGHT
from protocol.wire.messages import GroundTruth, SonarScan, WheelTicks
from runtime.elementary import atan2, cos_sin, hypot, sin
from runtime.timing import PERIOD_NS, UINT32
from runtime.units import NS_PER_S

OVERLAP_RAD: Final = 0.175
"""Overlap of the two front sectors of the bumper beyond the middle."""
REAR_RAD: Final = 2.0 * pi / 3.0

CLOSING_M_S: Final = 0.01
"""Speed towards a touched object above which the robot has caused the contact, because it would
have touched a static object, too. Turning on the spot never brings a disc closer."""

PERIOD_S: Final = PERIOD_NS / NS_PER_S

Moved: TypeAlias = tuple[Sequence[Disc], Sequence[Disc]]


class SharedSetup(NamedTuple):
    """Objects shared by the robots of one plant."""

    body: Body
    noise: Noise
    seed: int
    scene: Scene
    arena: Arena


class SimulatedRobot:
    """Move in two substeps, then sense, once per tick."""

    def __init__(
        self, common: SharedSetup, number: int, start: Pose, faults: Iterable[Fault]
    ) -> None:
        body, noise, seed, scene, self._arena = common
        self.faults = FaultSchedule(faults)
        self.drive = Drive(body, noise, seed, number)
        self._ring = Ring(body, noise, seed, number)
        self._caster = Caster(scene, body.sonar_max_m + body.radius_m, noise.incidence_limit_rad)
        self._track_m = body.track_m
        self._robot = self._arena.add_robot(start[0], start[1])
        self.pose = self.early_pose = self._before = start
        self._turned_rad = self._turning_rad = 0.0
        self._velocity_m_s = (0.0, 0.0)
        self._touched = 0
        self._closing = self._coasted = False
        self.bumper = 0
        self.clearance_m = 0.0
        self.score = Score(0, *start, 0.0)
        self.senses: tuple[WheelTicks | None, SonarScan | None] = (None, None)

    def coast(self, now_ns: int, span_s: float) -> None:
        """Move a whole substep without obstacles near; bit-identical to the arena's result."""
        self._roll(now_ns, span_s)
        (x_m, y_m, _), (x_m_s, y_m_s) = self.pose, self._velocity_m_s
        self._coasted = True
        self._turn_to(x_m + x_m_s * span_s, y_m + y_m_s * span_s)

    def set_off(self, now_ns: int, span_s: float) -> float:
        """Run the wheels for a substep and push the robot; return its speed."""
        speed_m_s = self._roll(now_ns, span_s)
        if self._coasted:
            self._arena.place(self._robot, *self.pose[:2])
            self._coasted = False
        self._arena.push(self._robot, *self._velocity_m_s)
        return speed_m_s

    def _roll(self, now_ns: int, span_s: float) -> float:
        """Compute a substep's velocity along the chord of the wheels' arc; return its speed."""
        left_m, right_m = self.drive.roll(now_ns, span_s, self.faults.at(now_ns))
        half_rad = (right_m - left_m) / self._track_m / 2.0
        speed_m_s = (left_m + right_m) / 2.0 / span_s
        if half_rad:
            speed_m_s *= sin(half_rad) / half_rad
        towards_rad = self.pose[2] + half_rad
        self._turning_rad = 2.0 * half_rad
        cosine, sine = cos_sin(towards_rad)
        self._velocity_m_s = speed_m_s * cosine, speed_m_s * sine
        return abs(speed_m_s)

    def arrive(self, close: bool) -> None:
        """Take the result of the substep; `close`: there may be a contact."""
        self._turn_to(*self._arena.position_m(self._robot))
        if close:
            self._touch(self._arena.contacts(self._robot))

    def _turn_to(self, x_m: float, y_m: float) -> None:
        """Set the position, and the heading after the substep's turn."""
        turning_rad = self._turning_rad
        heading_rad = self.pose[2] + turning_rad
        if not -pi <= heading_rad <= pi:
            heading_rad -= 2.0 * pi if heading_rad > 0.0 else -2.0 * pi
        self._turned_rad += turning_rad
        self.pose = (x_m, y_m, heading_rad)

    def _touch(self, contacts: Sequence[tuple[Point, bool]]) -> None:
        """Press the bumper; decide at the beginning of a contact whether the robot has caused it.

        A robot that drives and comes nearer to a static obstacle has caused the contact, even if it
        only grazes it; a robot that turns on the spot has not.
        """
        x_m_s, y_m_s = self._velocity_m_s
        began, drives = self._touched == 0, hypot(x_m_s, y_m_s) > CLOSING_M_S
        for direction, still in contacts:
            self._touched |= _sectors(direction, self.pose[2])
            closing_m_s = x_m_s * direction[0] + y_m_s * direction[1]
            least_m_s = 0.0 if still and drives else CLOSING_M_S
            self._closing |= began and closing_m_s > least_m_s

    def halfway(self) -> None:
        """Store the pose at the early pings."""
        self.early_pose = self.pose

    def end_tick(self) -> None:
        """Add the tick to the score."""
        self.bumper, self._touched = self._touched, 0
        closing, self._closing = self._closing, False
        self.clearance_m = self._arena.clearance_m(self._robot, self.pose[:2])
        self.score.add(*self.pose, self.clearance_m, self.bumper != 0, closing)

    def begin_tick(self) -> None:
        """Store the pose before the tick."""
        self._before = self.pose
        self._turned_rad = 0.0

    def restart_score(self, now_ns: int) -> None:
        """Begin a new score."""
        self.clearance_m = self._arena.clearance_m(self._robot, self.pose[:2])
        self.score = Score(now_ns, *self.pose, self.clearance_m)

    def sense(self, now_ns: int, moved: Moved) -> None:
        """Compute the sensor data of this tick; `moved`: see `Caster.cast`."""
        trouble = self.faults.at(now_ns)
        seq = (now_ns // PERIOD_NS) & UINT32
        reading = self._ring.read(
            self._caster.cast(self.early_pose, self.pose, moved), trouble.sonar
        )
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
            range_mm=reading.range_mm,
            ping_age_us=PING_AGE_US,
            valid=reading.valid,
            echo=reading.echo,
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
