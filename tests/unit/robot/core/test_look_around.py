"""Places hardly larger than the robot: proved to be closed by turning, and left by a door."""

from itertools import pairwise

from plant.world.file import loads
from protocol.outcome import RunOutcome
from robot.core.navigators.look_around import is_outside
from robot.core.navigators.proof import Proof
from study.trial.trial import Trial, run_trial
from tests.support.each import each

LEVELS = ("none", "default", "lossy", "harsh")
Point = tuple[float, float]


def drive_out(walls: list[tuple[Point, Point]], level: str, heading_deg: float) -> RunOutcome:
    """Drive from (1, 1) to a goal outside of these walls."""
    lines = [
        f"[[obstacle]]\nwall_m = [[{a[0]}, {a[1]}], [{b[0]}, {b[1]}]]\nthickness_m = 0.02"
        for a, b in walls
    ]
    head = f"""name = "cell"
size_m = [3.5, 2.0]
start = {{ x_m = 1.0, y_m = 1.0, heading_deg = {heading_deg} }}
goal = {{ x_m = 2.8, y_m = 1.0, position_tolerance_m = 0.05, heading_tolerance_deg = 3.0 }}"""
    world = loads("\n".join([head, *lines]))
    return run_trial(Trial(world=world, noise=level, seed=3, timeout_s=50.0))


def corners(side_m: float, beside_m: float) -> list[Point]:
    """Return the corners of a square with the start `beside_m` from its middle, the first last."""
    low, high = 1.0 + beside_m - 0.5 * side_m, 1.0 + beside_m + 0.5 * side_m
    return [(low, low), (high, low), (high, high), (low, high), (low, low)]


@each("level", LEVELS)
@each(("side_m", "within_s"), [(0.30, 30.0), (0.45, 30.0), (0.60, 30.0), (0.70, 45.0)])
def test_closed_cell_is_recognised(side_m: float, within_s: float, level: str) -> None:
    beside_m = 0.2 * (side_m - 0.28)
    outcome = drive_out(list(pairwise(corners(side_m, beside_m))), level, 100.0 * side_m)
    assert outcome.outcome == "unreachable"
    assert outcome.time_s <= within_s


@each(
    ("distance_m", "sigma_m", "outside"),
    [(0.53, 0.0, True), (0.52, 0.0, False), (0.7, 0.05, False)],
)
def test_goal_that_may_be_within_the_cell_proves_nothing(
    distance_m: float, sigma_m: float, outside: bool
) -> None:
    proof = Proof()
    proof.odometry.pxx = proof.odometry.pyy = sigma_m * sigma_m
    assert is_outside(proof, distance_m) is outside


@each("level", LEVELS)
@each(("door_m", "ends"), [(0.28, ("timeout", "lost")), (0.34, ("reached",))])
def test_cell_with_a_door_is_never_taken_for_closed(
    door_m: float, ends: tuple[str, ...], level: str
) -> None:
    """The robot is 0.24 m wide and drives through a door that is wider by 0.05 m."""
    first, second, *rest = corners(0.50, 0.02)
    posts = (first, (first[0] + 0.1, first[1])), ((first[0] + 0.1 + door_m, first[1]), second)
    outcome = drive_out([*posts, *pairwise([second, *rest])], level, 20.0)
    assert outcome.outcome in ends


@each("side_m", [0.40, 0.65])
def test_half_of_a_cell_is_left(side_m: float) -> None:
    """Half of a cell is no cell, wherever its open half is."""
    for walls in (corners(side_m, 0.0)[:3], corners(side_m, 0.0)[2:]):
        assert drive_out(list(pairwise(walls)), "default", 0.0).outcome == "reached"
