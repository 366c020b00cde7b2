"""The Virtual Goal Method with a memory: rotate the goal by the smallest open angle.

It extends the paper's method. At most 64 echoes are stored, within 0.9 m of the robot. The side is
latched while an obstacle is followed, and following ends only with progress. A closed chain of
echoes between robot and goal proves that the goal is unreachable (`proof`); a loop alone proves
nothing.

The work is spread over three ticks: record echoes, measure open headings, choose one. All at once
would take more than half of the period on the LPC1768.

Headings and turns without a unit in their names are brads: integers, 4096 to the circle.
"""

from math import sqrt
from typing import Final

from robot.core import states
from robot.core.navigators import evasion, loops, open_headings, pace, proof, vgm_following
from robot.core.navigators.vgm_following import VgmMemory
from robot.core.parameters import Params
from robot.core.perception import echoes as echo_memory
from robot.core.perception import sonar_ring
from robot.core.perception.echoes import BRADS, HALF_CIRCLE, NOTHING, SURE
from robot.core.perception.sonar_ring import Ring
from robot.core.values import TWO_PI, Decision, Goal, Pose, whole_cos_sin, wrap
from runtime.elementary import atan2, cos_sin

__all__ = ["VgmMemory", "step"]

PHASES: Final = 3  # ticks: record, measure, choose
RECORD: Final = 1
MEASURE: Final = 2
NEAR_GOAL_M: Final = 0.6  # nearer, a free straight path is taken without a margin
SAME_SIDE: Final = 228  # 20 degrees: a rotation on the other side must be smaller by this
MAX_FAILED_LEAVES: Final = 2  # then free ranges no longer count for leaving
LATCH: Final = 7  # choices for which the side of a small detour is kept
MAX_STILL: Final = 20  # choices, three seconds, within STILL_MM of one place
STILL_MM: Final = 20
BLOCK_MM: Final = 20  # distance of the stored point from the rim
BLOCK_WEIGHT: Final = 20  # looks through the point until it is dropped, six seconds
FARTHEST: Final = 1e5  # metres: larger values overflow millimetres


def step(memory: VgmMemory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Decide by the contract of `registry.NavigatorStep`; LOST: neither a path nor a proof."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    distance_m = sqrt(dx_m * dx_m + dy_m * dy_m)
    if not is_somewhere(pose, distance_m):
        return Decision(states.TO_GOAL, None, ring.nearest_m, 0.0, 0.0, goal.x_m, goal.y_m, 0.0)
    if goal.x_m != memory.goal_x_m or goal.y_m != memory.goal_y_m:
        memory.goal_x_m, memory.goal_y_m = goal.x_m, goal.y_m
        vgm_following.begin(memory)
    goal_rad = atan2(dy_m, dx_m)
    to_goal = int(BRADS * goal_rad)
    if evasion.watch(memory.flank_walker, ring, pose):
        forget(memory)
    radius_mm = int(1000.0 * params.radius_m)
    memory.phase = (memory.phase + 1) % PHASES
    if memory.following:
        vgm_following.watch_boundary(memory, pose, ring, radius_mm)
    observe(memory, pose, ring, radius_mm)
    if memory.phase == MEASURE:
        measure(memory, pose, ring, radius_mm)
    elif memory.phase != RECORD:
        memory.heading = to_goal
        if memory.flank_walker.ticks > 0:
            give_way(memory)
        elif memory.sectors.count or memory.following:
            choose(memory, pose, ring, to_goal, distance_m, params)
        if memory.following and memory.dwell < 0:
            memory.still = 0
        elif is_stationary(memory, int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)):
            block_heading(memory, pose, radius_mm)
        memory.heading = evasion.choose(
            memory.evasion, ring.pedestrians.people, memory.sectors, memory.heading, pose, params
        )
        memory.rotation = memory.heading - to_goal
        echo_memory.update_through(memory.echoes, ring, radius_mm)
    memory.before = pose
    if distance_m < memory.best_m:
        memory.best_m = distance_m
    return decision(memory, pose, ring, goal_rad, dx_m, dy_m, params)


def measure(memory: VgmMemory, pose: Pose, ring: Ring, radius_mm: int) -> None:
    """Compute which headings the stored echoes close."""
    sectors, echoes = memory.sectors, memory.echoes
    echo_memory.update_through(echoes, ring, radius_mm)
    open_headings.measure(sectors, echoes, pose, ring, memory.ease_mm, radius_mm)


def observe(memory: VgmMemory, pose: Pose, ring: Ring, radius_mm: int) -> None:
    """Fade and record the echoes in the phase for it; in the others record the nearest one."""
    before = memory.before or pose
    if memory.phase == RECORD:
        if memory.before is not None:
            # With the pose and the ranges of the choice one tick ago, which costs more than this.
            echo_memory.fade(memory.echoes, before)
        echo_memory.record(memory.echoes, before, pose, ring, radius_mm)
    else:
        echo_memory.record_nearest(memory.echoes, before, pose, ring, radius_mm)


def is_somewhere(pose: Pose, distance_m: float) -> bool:
    """Return whether the numbers are a possible pose; NaN and infinity are not."""
    return (
        distance_m < FARTHEST
        and -FARTHEST < pose.x_m < FARTHEST
        and -FARTHEST < pose.y_m < FARTHEST
        and -TWO_PI < pose.heading_rad < TWO_PI
    )


def forget(memory: VgmMemory) -> None:
    """Stop following and drop all echoes: the followed object was a pedestrian."""
    memory.following = False
    echo_memory.clear(memory.echoes)
    proof.void(memory.proof)
    memory.sectors.count = 0


def is_stationary(memory: VgmMemory, x_mm: int, y_mm: int) -> bool:
    """Return whether the robot has not moved for MAX_STILL choices."""
    dx_mm, dy_mm = x_mm - memory.still_x_mm, y_mm - memory.still_y_mm
    if (
        memory.flank_walker.ticks
        or not -STILL_MM < dx_mm < STILL_MM
        or not -STILL_MM < dy_mm < STILL_MM
    ):
        memory.still_x_mm, memory.still_y_mm, memory.still = x_mm, y_mm, 0
    memory.still += 1
    return memory.still > MAX_STILL


def block_heading(memory: VgmMemory, pose: Pose, radius_mm: int) -> None:
    """Store a point ahead: the heading looks open, but the guard stops the robot."""
    memory.still = 0
    away_mm = radius_mm + BLOCK_MM
    cosine, sine = cos_sin(memory.heading / BRADS)
    x_mm = int(1000.0 * pose.x_m + away_mm * cosine)
    y_mm = int(1000.0 * pose.y_m + away_mm * sine)
    echo_memory.put(memory.echoes, x_mm, y_mm, BLOCK_WEIGHT)


def give_way(memory: VgmMemory) -> None:
    """Turn away from a pedestrian at the flank where that is open, and let it pass ahead."""
    sectors, flank_walker = memory.sectors, memory.flank_walker
    flank_walker.ticks = max(flank_walker.ticks - PHASES, 0)
    left = open_headings.sweep(sectors, flank_walker.heading, states.LEFT, sectors.tight)
    right = open_headings.sweep(sectors, flank_walker.heading, states.RIGHT, sectors.tight)
    side, turn = (states.LEFT, left) if left <= right else (states.RIGHT, right)
    memory.aside = loops.kept(memory.passed, side, loops.MAX_CHANGES)
    memory.heading = flank_walker.heading + side * turn


def choose(
    memory: VgmMemory, pose: Pose, ring: Ring, to_goal: int, distance_m: float, params: Params
) -> None:
    """Choose: keep following or leave; drive straight, make a detour, or start to follow."""
    x_cm, y_cm = int(100.0 * pose.x_m), int(100.0 * pose.y_m)
    if memory.following:
        if leaves(memory, pose, ring, to_goal, distance_m, params):
            leave(memory, x_cm, y_cm)
        else:
            vgm_following.follow(memory, pose, distance_m)
    elif closes(memory, pose, to_goal, distance_m, params):
        vgm_following.hit(memory, ring, x_cm, y_cm, to_goal, distance_m)


def closes(memory: VgmMemory, pose: Pose, to_goal: int, distance_m: float, params: Params) -> bool:
    """Return whether an obstacle is in the way to the goal; pass one beside it by a detour."""
    sectors = memory.sectors
    if open_headings.closer(sectors, to_goal, sectors.wide) == NOTHING:
        return False
    if distance_m < NEAR_GOAL_M and is_clear(memory, pose, to_goal, distance_m, params):
        return False
    closing = open_headings.closer(sectors, to_goal, sectors.tight)
    if closing != NOTHING and sectors.point[closing] != NOTHING:
        return True
    turn_aside(memory, to_goal, vgm_following.SOFT if closing == NOTHING else HALF_CIRCLE)
    return False


def turn_aside(memory: VgmMemory, to_goal: int, most: int) -> None:
    """Take the smallest rotation with a wide margin, if it is small; keep its side for a while."""
    sectors = memory.sectors
    left = open_headings.sweep(sectors, to_goal, states.LEFT, sectors.wide)
    right = open_headings.sweep(sectors, to_goal, states.RIGHT, sectors.wide)
    if memory.aside_ticks > 0:
        memory.aside_ticks -= 1
        if memory.aside == states.LEFT:
            right += SAME_SIDE
        else:
            left += SAME_SIDE
    side = states.LEFT if left <= right else states.RIGHT
    side = loops.kept(memory.passed, side, loops.MAX_DETOUR_CHANGES)
    turn = left if side == states.LEFT else right
    if turn < most:
        memory.aside, memory.aside_ticks = side, LATCH
        memory.heading = to_goal + side * turn


def leaves(
    memory: VgmMemory, pose: Pose, ring: Ring, to_goal: int, distance_m: float, params: Params
) -> bool:
    """Return whether the path to the goal is open and leads nearer than ever (DistBug's rule).

    The free ranges count only until too many leaves have failed.
    """
    if distance_m < NEAR_GOAL_M and is_clear(memory, pose, to_goal, distance_m, params):
        return True
    sectors = memory.sectors
    if open_headings.closer(sectors, to_goal, sectors.wide) != NOTHING:
        return False
    free_m = 0.0
    if memory.failed_leaves < MAX_FAILED_LEAVES:
        alpha_rad = wrap(to_goal / BRADS - pose.heading_rad)
        free_m = pace.free_towards(ring, alpha_rad, distance_m, params)
    return distance_m - free_m <= memory.best_m - vgm_following.STEP_M


def leave(memory: VgmMemory, x_cm: int, y_cm: int) -> None:
    """Stop following; note the place and the distance."""
    memory.following = False
    memory.left_m = memory.best_m
    memory.left_place = loops.packed(x_cm, y_cm)


def is_clear(
    memory: VgmMemory, pose: Pose, to_goal: int, distance_m: float, params: Params
) -> bool:
    """Return whether no stored echo touches the straight path to a near goal, without a margin."""
    echoes = memory.echoes
    along_x, along_y = whole_cos_sin(to_goal / BRADS)
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    length_mm, radius_mm = int(1000.0 * distance_m), int(1000.0 * params.radius_m)
    for k in range(echoes.count):
        dx_mm, dy_mm = echoes.x_mm[k] - x_mm, echoes.y_mm[k] - y_mm
        along_mm = dx_mm * along_x + dy_mm * along_y >> 10
        aside_mm = dy_mm * along_x - dx_mm * along_y >> 10
        body_mm = radius_mm - (open_headings.DOUBT * echoes.spread_mm[k] >> 2)
        if along_mm < 0 or not -body_mm < aside_mm < body_mm or echoes.weight[k] < SURE:
            continue
        past_mm = along_mm - length_mm
        if past_mm <= 0 or past_mm * past_mm + aside_mm * aside_mm < body_mm * body_mm:
            return False
    return True


def branch_of(memory: VgmMemory) -> int:
    """Return the branch of the decision."""
    if memory.given_up:
        return states.GIVE_UP
    if memory.lost:
        return states.LOST
    if not memory.following and memory.rotation == 0:
        return states.TO_GOAL
    side = memory.side if memory.following else memory.aside
    return states.PASS_LEFT if side == states.LEFT else states.PASS_RIGHT


def count_side(memory: VgmMemory, branch: int) -> None:
    """Count the side on which an obstacle is passed; after the last change keep it."""
    if branch not in (states.PASS_LEFT, states.PASS_RIGHT):
        return
    side = states.LEFT if branch == states.PASS_LEFT else states.RIGHT
    memory.passed = loops.counted(memory.passed, side)
    if not loops.are_left(memory.passed):
        memory.side = memory.aside = side


def speed_limit(memory: VgmMemory, error_rad: float, params: Params) -> float:
    """Return the speed limit by echoes, heading error, and people."""
    if 0 < memory.flank_walker.ticks < evasion.GIVE_WAY_TICKS - evasion.DRIVE_TICKS:
        return 0.0
    speed_m_s = pace.speed(memory.held, memory.sectors.free_mm, error_rad, params)
    return min(speed_m_s, memory.evasion.most_m_s)


def rotation_rad(memory: VgmMemory, ring: Ring, branch: int, dx_m: float, dy_m: float) -> float:
    """Return the rotation of the goal: to and fro where needed, and away from a near flank."""
    gamma_rad = 0.0 if memory.rotation == 0 else wrap(memory.rotation / BRADS)
    if branch == states.TO_GOAL:
        distance_m = sqrt(dx_m * dx_m + dy_m * dy_m)
        gamma_rad = pace.weave(ring, distance_m)
        if gamma_rad == 0.0:
            gamma_rad = pace.dither(distance_m)
    elif memory.following and memory.sectors.free_mm < pace.SLOW_MM:
        gamma_rad += pace.sweep(memory.echoes.turn)
    off_rad = pace.keep_off(memory.held)
    return wrap(gamma_rad + off_rad)


def decision(
    memory: VgmMemory,
    pose: Pose,
    ring: Ring,
    goal_rad: float,
    dx_m: float,
    dy_m: float,
    params: Params,
) -> Decision:
    """Return the decision: virtual goal at the chosen heading, flank bias, and speed limit."""
    alpha_rad = wrap(goal_rad - pose.heading_rad)
    branch = branch_of(memory)
    count_side(memory, branch)
    pace.hold(memory.held, ring)
    gamma_rad = rotation_rad(memory, ring, branch, dx_m, dy_m)
    speed_m_s = speed_limit(memory, wrap(alpha_rad + gamma_rad), params)
    cosine, sine = cos_sin(gamma_rad)
    return Decision(
        branch,
        sonar_ring.bearing_rad(ring),
        ring.nearest_m,
        alpha_rad,
        gamma_rad,
        pose.x_m + cosine * dx_m - sine * dy_m,
        pose.y_m + sine * dx_m + cosine * dy_m,
        speed_m_s,
    )
