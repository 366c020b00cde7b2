"""Run one trial in a world, watch it, and judge it by the properties.

The causes of a failure are recorded: the lap before a claim, and a contact.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, pi
from typing import Any, Final

from plant.model.geometry import edges, moves
from plant.sim.physics import MovingDisc, Surface, line
from plant.sim.simulation import Plant
from protocol.outcome import RunOutcome
from protocol.wire.messages import GroundTruth
from protocol.wire.reasons import Reason
from protocol.world import Obstacle, Polyline, World, WorldCircle, WorldPolygon
from robot.core import states
from robot.core.navigators import proof as proofs
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import EVERY, Outputs
from runtime.elementary import atan2, hypot
from runtime.units import NS_PER_S
from study.falsify.properties import (
    ContactRecord,
    Evaluation,
    LapRecord,
    scores_of,
    time_limit_s,
    violated_by,
)
from study.runner.run_task import mahalanobis2
from study.trial.core_loop import Behaviour, CoreLoop
from study.trial.trial import Trial, run_trial

LOOK_EVERY: Final = 10
"""Ticks between looks at the position; the estimate changes slowly."""

TOUCHING_M: Final = 1e-3
CLOSE_M: Final = 0.1
"""Clearance below which the speed is kept, because a contact may follow."""

LATE: Final = 1200
"""Ticks, one minute: the distance driven in the last of them distinguishes kinds of time-out."""

FLOOR_M2: Final = 1e-6
"""Variance in m² that is added to the claimed one: the wire rounds positions to millimetres."""

MS_PER_S: Final = 1000.0
DECIMALS: Final = 6
"""Decimals to which distances in metres are compared: a wall is as near as its end there."""


class Monitor:
    """Watch a trial: behaviour, position error, the last lap, and the first contact."""

    __slots__ = (
        *("behaviour", "contact", "contact_branch", "mahalanobis2", "nearest_goal_m", "places"),
        *("_echoes", "_gap", "_gaps", "_speed_m_s", "_way_mm"),
    )

    def __init__(self) -> None:
        self.behaviour = Behaviour()
        self.contact_branch: int = states.NO_BRANCH
        self.contact: ContactRecord | None = None
        self.mahalanobis2 = 0.0
        self.nearest_goal_m = inf
        self.places: list[tuple[float, float]] = []
        self._echoes: list[tuple[int, float] | None] = [None] * SONARS
        self._speed_m_s = 0.0
        self._gap = proofs.NO_GAP
        self._gaps = self._way_mm = 0

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Watch one tick."""
        self.behaviour(plant, onboard, outputs)
        if self.contact is None:
            self._watch_contact(plant, onboard)
        decision = outputs.decision
        untouched = self.contact_branch == states.NO_BRANCH
        if decision is not None and untouched and plant.attitude()[1] < TOUCHING_M:
            self.contact_branch = decision.branch
        self._watch_lap(onboard)
        if self.behaviour.ticks % LOOK_EVERY:
            return
        truth, odometry = plant.truth(), onboard.state.odometry
        self.places.append((truth.x_m, truth.y_m))
        self.nearest_goal_m = min(self.nearest_goal_m, onboard.state.goal_distance_m)
        off = truth.x_m - odometry.pose.x_m, truth.y_m - odometry.pose.y_m
        spread = odometry.pxx + FLOOR_M2, odometry.pxy, odometry.pyy + FLOOR_M2
        self.mahalanobis2 = max(self.mahalanobis2, mahalanobis2(*off, spread))

    def _watch_lap(self, onboard: CoreLoop) -> None:
        """Count the gaps that the chain has crossed since the mark of the lap."""
        proof: Any = getattr(onboard.state.memory, "proof", None)
        if proof is None:
            return
        if proof.way_mm < self._way_mm:
            self._gaps = 0
        if proof.gap == proofs.HOPPED and self._gap == proofs.WAITING:
            self._gaps += 1
        self._way_mm, self._gap = proof.way_mm, proof.gap

    def _watch_contact(self, plant: Plant, onboard: CoreLoop) -> None:
        """Keep speed and newest echoes until the first contact, and record that."""
        clearance_m = plant.attitude()[1]
        if clearance_m >= TOUCHING_M:
            keep_echoes(self._echoes, onboard.state.ring)
            if clearance_m < CLOSE_M:
                self._speed_m_s = plant.truth().speed_m_s
            return
        touched, bearing_rad = nearest_thing(plant.world, plant.truth())
        sonar = sonar_towards(bearing_rad)
        echo = None if sonar is None else self._echoes[sonar]
        self.contact = ContactRecord(
            touched=touched,
            speed_m_s=self._speed_m_s,
            is_in_view=sonar is not None,
            range_m=None if echo is None else echo[1],
            age_s=None if echo is None else (onboard.now_ms - echo[0]) / MS_PER_S,
        )

    @property
    def lap(self) -> LapRecord | None:
        """The last lap; None without one, or for a navigator without proofs."""
        return LapRecord(self._way_mm / 1000.0, self._gaps) if self._way_mm else None

    @property
    def moved_late_m(self) -> float:
        """Largest distance from the last place during the last minute."""
        last = self.places[-1] if self.places else (0.0, 0.0)
        late = self.places[-LATE // LOOK_EVERY :]
        return max((hypot(x - last[0], y - last[1]) for x, y in late), default=0.0)


def keep_echoes(echoes: list[tuple[int, float] | None], ring: Ring) -> None:
    """Store time and range of each echo in the ring; a sonar without an echo keeps its last one."""
    ranges_m, pinged_ms = ring.range_m, ring.pinged_ms
    for i in EVERY:
        range_m = ranges_m[i]
        if range_m is not None and range_m < inf:
            echoes[i] = (pinged_ms[i], range_m)


def sonar_towards(bearing_rad: float) -> int | None:
    """Return the sonar whose cone contains a bearing in the robot's frame, or None."""
    sonar = min(EVERY, key=lambda i: abs(BEARINGS[i] - bearing_rad))
    return sonar if abs(BEARINGS[sonar] - bearing_rad) <= HALF_CONE else None


def nearest_thing(world: World, truth: GroundTruth) -> tuple[str, float]:
    """Return the name of the thing nearest to the robot, and its bearing in the robot's frame.

    The number in a name is that of the obstacle in the world file, counted from 1.
    """
    at = truth.x_m, truth.y_m

    def away_m(named: tuple[str, Surface]) -> float:
        return round(hypot(*named[1].offset_m(*at)) - named[1].radius_m, DECIMALS)

    name, surface = min(surfaces(world, truth.time_ns / NS_PER_S), key=away_m)
    off_x_m, off_y_m = surface.offset_m(*at)
    bearing_rad = atan2(off_y_m, off_x_m) - truth.heading_rad
    return name, (bearing_rad + pi) % (2.0 * pi) - pi


def surfaces(world: World, time_s: float) -> Iterator[tuple[str, Surface]]:
    """Yield all surfaces of a world at a time, with names; free ends of walls come first."""
    for number, obstacle in enumerate(world.obstacles, 1):
        yield from surfaces_of(obstacle, number, time_s)
    if world.walls:
        width_m, height_m = world.size_m
        corners = ((0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m))
        for a, b in edges(corners, closed=True):
            yield "the outer wall", line(a, b, 0.0)


def surfaces_of(obstacle: Obstacle, number: int, time_s: float) -> Iterator[tuple[str, Surface]]:
    """Yield the surfaces of an obstacle at a time, with names."""
    if isinstance(obstacle, WorldCircle):
        walks = moves(obstacle)
        at = MovingDisc(obstacle).position_m(time_s) if walks else (obstacle.x_m, obstacle.y_m)
        yield f"{'person' if walks else 'post'} {number}", line(at, at, obstacle.radius_m)
    elif isinstance(obstacle, WorldPolygon):
        for a, b in edges(obstacle.points_m, closed=True):
            yield f"block {number}", line(a, b, 0.0)
    else:
        yield from surfaces_of_wall(obstacle, number)


def surfaces_of_wall(wall: Polyline, number: int) -> Iterator[tuple[str, Surface]]:
    """Yield the surfaces of a wall; where an end is nearest, its own surface comes first."""
    points_m, radius_m = wall.points_m, wall.thickness_m / 2.0
    if points_m[0] != points_m[-1]:
        for end in (points_m[0], points_m[-1]):
            yield f"the end of wall {number}", line(end, end, radius_m)
    for a, b in edges(points_m, closed=False):
        yield f"wall {number}", line(a, b, radius_m)


STILL_M: Final = 0.3
"""A robot that moved less than this during its last minute no longer drives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A navigator with its side, at a level of noise."""

    navigator: str
    side: str
    noise: str
    detour: float


def trial_of(subject: Subject, world: World, seed: int, limit_s: float | None = None) -> Trial:
    """Return the trial of a subject in a world whose shortest path is known.

    `limit_s` None: the time limit of the world.
    """
    return Trial(
        world=world,
        navigator=subject.navigator,
        side=subject.side,
        seed=seed,
        noise=subject.noise,
        timeout_s=limit_s or time_limit_s(world),
    )


def evaluate(subject: Subject, world: World, seed: int, limit_s: float | None = None) -> Evaluation:
    """Run the trial and return its evaluation."""
    watch, trial = Monitor(), trial_of(subject, world, seed, limit_s)
    outcome = run_trial(trial, watch)
    onboard = watch.behaviour.onboard
    reason = 0 if onboard is None else onboard.state.machine.goal_reason
    reachable = bool(world.reachable)
    return Evaluation(
        world=world,
        seed=seed,
        kind=kind_of(outcome, reason, watch),
        violated=violated_by(
            outcome, reason, watch.mahalanobis2, subject.detour, reachable=reachable
        ),
        scores=scores_of(outcome, watch.mahalanobis2, trial.timeout_s, reachable=reachable),
        outcome=outcome,
        goal_reason=reason,
        avoidances=watch.behaviour.avoidances,
        side_changes=watch.behaviour.side_changes,
        mahalanobis2=watch.mahalanobis2,
        nearest_goal_m=watch.nearest_goal_m,
        contact_branch=watch.contact_branch,
        moved_late_m=watch.moved_late_m,
        lap=watch.lap,
        contact=watch.contact,
    )


def kind_of(outcome: RunOutcome, reason: int, watch: Monitor) -> str:
    """Return the kind of end in a word or two joined by a hyphen."""
    if outcome.own_contacts:
        return f"contact-{BRANCHES.get(watch.contact_branch, 'stopped')}"
    if reason == Reason.UNREACHABLE:
        return "claim"
    if outcome.reached:
        return "reached"
    if outcome.outcome != "timeout":
        return Reason(reason).name.lower().replace("_", "-")
    return "timeout-still" if watch.moved_late_m < STILL_M else "timeout-moving"


BRANCHES: Final = {
    states.TO_GOAL: "to-goal",
    states.PASS_LEFT: "passing",
    states.PASS_RIGHT: "passing",
    states.ALIGN: "aligning",
    states.GIVE_UP: "giving-up",
}
