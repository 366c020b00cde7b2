"""The Virtual Goal Method with a memory: the goal is turned by the smallest rotation that is open.

What the paper's method lacks is here: the echoes of the last metre are remembered, the side is
latched while an obstacle is followed, following ends only with progress, a closed loop reverses
the side once, and a second one means that no way leads to the goal.
"""

from math import atan2, cos, inf, pi, sin, sqrt

from robot.core import echoes as echo_memory
from robot.core import headings, loops, states
from robot.core import ring as rings
from robot.core.echoes import SURE, Echoes
from robot.core.geometry import BEARINGS, HALF_CONE, wrap
from robot.core.headings import LOOK_M, NOTHING, Sectors
from robot.core.loops import Loops
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.typed import Final
from robot.core.values import SONARS, Decision, Goal, Pose

STEP_M: Final = 0.10
"""Following ends only where the way to go gets shorter than ever by this much."""
SHARP_RAD: Final = 70.0 * pi / 180.0
PATIENCE: Final = 14
ENDLESS: Final = 1_000_000
PROMISES: Final = 3
AWAY: Final = 1.3
AWAY_M: Final = 0.4
ISLANDS: Final = 6
SOFT_RAD: Final = 40.0 * pi / 180.0
NEAR_GOAL_M: Final = 0.6
LOST_M: Final = 0.6
HELD_MM: Final = 120
SQUEEZE_M: Final = 0.02
FLANK_M: Final = 0.06
FLANK_RAD: Final = 40.0 * pi / 180.0
CRAWL_M_S: Final = 0.04
AHEAD_RAD: Final = 40.0 * pi / 180.0
BESIDE: Final = 0.5 * pi


class Memory:
    """`side` is where the followed obstacle is passed, `best_m` the least distance to the goal so
    far, `anchor` the place of the echo being followed."""

    __slots__ = (
        "anchor_x_m",
        "anchor_y_m",
        "best_m",
        "broken",
        "ease_m",
        "echoes",
        "following",
        "given_up",
        "heading_rad",
        "hit_m",
        "islands",
        "left_m",
        "loops",
        "patience",
        "sectors",
        "shut",
        "side",
        "turned_back",
    )

    def __init__(self) -> None:
        self.echoes = Echoes()
        self.sectors = Sectors()
        self.loops = Loops()
        self.side: int = states.LEFT
        self.following = False
        self.given_up = False
        self.best_m = inf
        self.ease_m = 0.0
        self.anchor_x_m = self.anchor_y_m = 0.0
        self.heading_rad = 0.0
        self.turned_back = False
        self.islands = 0
        self.hit_m = 0.0
        self.left_m = inf
        self.broken = 0
        self.patience = PATIENCE
        self.shut = 0


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Where to drive now, and how fast at most."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    distance_m = sqrt(dx_m * dx_m + dy_m * dy_m)
    goal_rad = atan2(dy_m, dx_m)
    echo_memory.update(memory.echoes, pose, ring, params)
    headings.measure(memory.sectors, memory.echoes, pose, ring, memory.ease_m, params)
    if memory.following:
        follow(memory, pose, ring, goal, goal_rad, distance_m, params)
    if not memory.following:
        seek(memory, pose, ring, goal, goal_rad, distance_m, params)
    if distance_m < memory.best_m:
        memory.best_m = distance_m
    return decision(memory, pose, ring, goal_rad, dx_m, dy_m, params)


def seek(
    memory: Memory,
    pose: Pose,
    ring: Ring,
    goal: Goal,
    goal_rad: float,
    distance_m: float,
    params: Params,
) -> None:
    """Straight for the goal, aside by a little for room; a closed way is a hit."""
    sectors = memory.sectors
    memory.heading_rad = goal_rad
    if sectors.count == 0 or headings.is_open(sectors, goal_rad, sectors.wide_rad):
        return
    if distance_m < NEAR_GOAL_M and is_clear(memory, pose, goal_rad, distance_m, params):
        return
    if headings.is_open(sectors, goal_rad, sectors.tight_rad):
        left_rad = headings.sweep(sectors, goal_rad, states.LEFT, sectors.wide_rad)
        right_rad = headings.sweep(sectors, goal_rad, states.RIGHT, sectors.wide_rad)
        if min(left_rad, right_rad) < SOFT_RAD:
            memory.heading_rad = (
                goal_rad + left_rad if left_rad < right_rad else goal_rad - right_rad
            )
        return
    hit(memory, pose, goal_rad, distance_m)
    follow(memory, pose, ring, goal, goal_rad, distance_m, params)


def hit(memory: Memory, pose: Pose, goal_rad: float, distance_m: float) -> None:
    """Latch the side of the smaller rotation, but not the one tried at this place before."""
    sectors = memory.sectors
    left_rad = headings.sweep(sectors, goal_rad, states.LEFT, sectors.tight_rad)
    right_rad = headings.sweep(sectors, goal_rad, states.RIGHT, sectors.tight_rad)
    side = states.LEFT if left_rad <= right_rad else states.RIGHT
    memory.side = loops.hit(memory.loops, pose, side)
    memory.following = True
    memory.hit_m = distance_m
    if memory.best_m < memory.left_m - STEP_M:
        memory.broken = 0
    elif memory.left_m < inf:
        memory.broken += 1
    memory.patience = PATIENCE
    nearest = NOTHING
    for k in range(sectors.count):
        off_rad = (sectors.bearing_rad[k] - goal_rad + pi) % (2.0 * pi) - pi
        if -sectors.tight_rad[k] < off_rad < sectors.tight_rad[k] and (
            nearest == NOTHING or sectors.away_m[k] < sectors.away_m[nearest]
        ):
            nearest = k
    hold(memory, nearest)


def hold(memory: Memory, sector: int) -> None:
    """Follow the point of this sector from now on."""
    if sector != NOTHING:
        k = memory.sectors.point[sector]
        memory.anchor_x_m = 0.001 * memory.echoes.x_mm[k]
        memory.anchor_y_m = 0.001 * memory.echoes.y_mm[k]


def follow(
    memory: Memory,
    pose: Pose,
    ring: Ring,
    goal: Goal,
    goal_rad: float,
    distance_m: float,
    params: Params,
) -> None:
    """Along the obstacle: the first open heading from the followed point, on the latched side."""
    sectors, side = memory.sectors, memory.side
    if leaves(memory, pose, ring, goal_rad, distance_m, params):
        memory.following = False
        return
    if not is_held(memory) and not regain(memory, pose):
        memory.following = False
        return
    start_rad = atan2(memory.anchor_y_m - pose.y_m, memory.anchor_x_m - pose.x_m)
    turn_rad = open_turn(memory, pose, start_rad, params)
    if turn_rad >= 2.0 * pi:
        shut_in(memory)
        return
    memory.shut = 0
    memory.heading_rad = start_rad + side * turn_rad
    hold(memory, sectors.closing)
    if loops.drop(memory.loops, pose):
        come_round(memory, goal)
    elif is_astray(memory, distance_m):
        memory.side = -side
        memory.patience = ENDLESS
        loops.restart(memory.loops)


def is_astray(memory: Memory, distance_m: float) -> bool:
    """Whether it went on for long on this side, and only away from the goal: the other side is
    tried, and each time with twice the patience (linear search by doubling)."""
    return memory.loops.crumbs >= memory.patience and distance_m > AWAY * memory.hit_m + AWAY_M


def open_turn(memory: Memory, pose: Pose, start_rad: float, params: Params) -> float:
    """How far to turn from the followed point: with a wide margin where that costs little, else in
    the middle of what is open, and through a gap without a margin before turning back."""
    sectors, side = memory.sectors, memory.side
    wide_rad = headings.sweep(sectors, start_rad, side, sectors.wide_rad)
    turn_rad = headings.sweep(sectors, start_rad, side, sectors.tight_rad)
    margins = sectors.tight_rad
    off_rad = wrap(start_rad + side * turn_rad - pose.heading_rad)
    if turn_rad >= 2.0 * pi or not -SHARP_RAD < off_rad < SHARP_RAD:
        headings.squeeze(sectors, params)
        closing = sectors.closing
        squeezed_rad = headings.sweep(sectors, start_rad, side, sectors.squeezed_rad)
        if squeezed_rad < turn_rad - SOFT_RAD:
            turn_rad = squeezed_rad
            margins = sectors.squeezed_rad
        else:
            sectors.closing = closing
    if turn_rad >= 2.0 * pi:
        return turn_rad
    if turn_rad <= wide_rad < turn_rad + SOFT_RAD:
        return wide_rad
    return turn_rad + min(0.5 * headings.room(sectors, turn_rad, margins), SOFT_RAD)


def come_round(memory: Memory, goal: Goal) -> None:
    """The way has closed upon itself. Where the loop keeps robot and goal apart, turn back once,
    and the second time give up; where it does not, it was an island: go for the goal again."""
    around = loops.turns_left(memory.loops)
    island = around != (memory.side == states.LEFT)
    inside = loops.encloses(memory.loops, goal.x_m, goal.y_m)
    loops.restart(memory.loops)
    if island != inside:
        memory.islands += 1
        memory.best_m = memory.left_m = inf
        memory.following = False
        if memory.islands > ISLANDS:
            memory.given_up = True
    elif memory.turned_back:
        memory.given_up = True
    else:
        memory.turned_back = True
        memory.side = -memory.side
        memory.ease_m = SQUEEZE_M


def shut_in(memory: Memory) -> None:
    """Every heading is closed: turn on, with smaller margins, and in the end believe none of it."""
    memory.shut += 1
    if memory.shut > 60:
        echo_memory.clear(memory.echoes)
        memory.shut = 0
        memory.following = False


def is_held(memory: Memory) -> bool:
    """Whether an echo is still remembered where the followed one was."""
    x_mm, y_mm = 1000.0 * memory.anchor_x_m, 1000.0 * memory.anchor_y_m
    echoes = memory.echoes
    for k in range(echoes.count):
        if (
            -HELD_MM < echoes.x_mm[k] - x_mm < HELD_MM
            and -HELD_MM < echoes.y_mm[k] - y_mm < HELD_MM
            and echoes.weight[k] >= SURE
        ):
            return True
    return False


def regain(memory: Memory, pose: Pose) -> bool:
    """Follow the nearest remembered echo instead."""
    echoes = memory.echoes
    x_mm, y_mm = 1000.0 * pose.x_m, 1000.0 * pose.y_m
    best, least = NOTHING, 1e6 * LOST_M * LOST_M
    for k in range(echoes.count):
        dx_mm, dy_mm = echoes.x_mm[k] - x_mm, echoes.y_mm[k] - y_mm
        square = dx_mm * dx_mm + dy_mm * dy_mm
        if square < least and echoes.weight[k] >= SURE:
            best, least = k, square
    if best == NOTHING:
        return False
    memory.anchor_x_m, memory.anchor_y_m = 0.001 * echoes.x_mm[best], 0.001 * echoes.y_mm[best]
    return True


def leaves(
    memory: Memory, pose: Pose, ring: Ring, goal_rad: float, distance_m: float, params: Params
) -> bool:
    """Whether the way to the goal is open and leads nearer to it than ever (DistBug's rule)."""
    if distance_m < NEAR_GOAL_M and is_clear(memory, pose, goal_rad, distance_m, params):
        return True
    sectors = memory.sectors
    if not headings.is_open(sectors, goal_rad, sectors.wide_rad):
        return False
    free_m = 0.0
    if memory.broken < PROMISES:
        free_m = free_towards(ring, wrap(goal_rad - pose.heading_rad), distance_m, params)
    if distance_m - free_m > memory.best_m - STEP_M:
        return False
    memory.left_m = memory.best_m
    return True


def free_towards(ring: Ring, alpha_rad: float, distance_m: float, params: Params) -> float:
    """How far the robot could drive towards the goal until something were a hit; 0 out of view."""
    if not -BESIDE < alpha_rad < BESIDE:
        return 0.0
    free_m = params.sonar_max_m
    for i in range(SONARS):
        range_m = ring.range_m[i]
        aside_rad = abs(BEARINGS[i] - alpha_rad) - HALF_CONE
        if range_m is None:
            if aside_rad < 0.0:
                return 0.0
            continue
        if range_m >= free_m:
            continue
        reach_m = range_m + params.radius_m
        if aside_rad <= 0.0:
            free_m = range_m
        elif reach_m * sin(aside_rad) < params.radius_m + headings.TIGHT_M:
            free_m = min(free_m, reach_m * cos(aside_rad) - params.radius_m)
    if free_m >= distance_m:
        return distance_m
    return max(0.0, free_m - LOOK_M - 0.05)


def is_clear(
    memory: Memory, pose: Pose, goal_rad: float, distance_m: float, params: Params
) -> bool:
    """Whether no remembered echo touches the straight way to a near goal, without any margin."""
    echoes = memory.echoes
    along_x, along_y = cos(goal_rad), sin(goal_rad)
    x_mm, y_mm = 1000.0 * pose.x_m, 1000.0 * pose.y_m
    length_mm = 1000.0 * distance_m
    for k in range(echoes.count):
        if echoes.weight[k] < SURE:
            continue
        dx_mm, dy_mm = echoes.x_mm[k] - x_mm, echoes.y_mm[k] - y_mm
        along_mm = dx_mm * along_x + dy_mm * along_y
        aside_mm = dy_mm * along_x - dx_mm * along_y
        body_mm = 1000.0 * params.radius_m - headings.DOUBT * echoes.spread_mm[k]
        if along_mm < 0.0 or not -body_mm < aside_mm < body_mm:
            continue
        if along_mm <= length_mm:
            return False
        past_mm = along_mm - length_mm
        if past_mm * past_mm + aside_mm * aside_mm < body_mm * body_mm:
            return False
    return True


def decision(
    memory: Memory,
    pose: Pose,
    ring: Ring,
    goal_rad: float,
    dx_m: float,
    dy_m: float,
    params: Params,
) -> Decision:
    """The virtual goal at the chosen heading, away from a flank that is too near, and the speed."""
    error_rad = wrap(memory.heading_rad - pose.heading_rad)
    error_rad = keep_off(ring, error_rad)
    gamma_rad = wrap(pose.heading_rad + error_rad - goal_rad)
    speed_m_s = speed(memory, pose, ring, error_rad, params)
    branch: int = states.TO_GOAL
    if memory.given_up:
        branch = states.GIVE_UP
    elif memory.following:
        branch = states.PASS_LEFT if memory.side == states.LEFT else states.PASS_RIGHT
    elif gamma_rad != 0.0:
        branch = states.PASS_LEFT if gamma_rad > 0.0 else states.PASS_RIGHT
    cosine, sine = cos(gamma_rad), sin(gamma_rad)
    return Decision(
        branch,
        rings.bearing_rad(ring),
        ring.nearest_m,
        wrap(goal_rad - pose.heading_rad),
        gamma_rad,
        pose.x_m + cosine * dx_m - sine * dy_m,
        pose.y_m + sine * dx_m + cosine * dy_m,
        speed_m_s,
    )


def keep_off(ring: Ring, error_rad: float) -> float:
    """Bias the turn away from a flank nearer than it should be."""
    if ring.nearest_m >= FLANK_M:
        return error_rad
    left_m = right_m = FLANK_M
    for i in range(SONARS):
        range_m = ring.range_m[i]
        if range_m is not None:
            if i < SONARS // 2:
                right_m = min(right_m, range_m)
            else:
                left_m = min(left_m, range_m)
    return wrap(error_rad + FLANK_RAD * (left_m - right_m) / FLANK_M)


def speed(memory: Memory, pose: Pose, ring: Ring, error_rad: float, params: Params) -> float:
    """Slower the nearer something is ahead, and while the heading is far off."""
    most_m_s = params.v_max_m_s
    if ring.nearest_m < 0.3:
        for i in (2, 3, 4, 5):
            range_m = ring.range_m[i]
            if range_m is not None:
                rate = 1.4 if 2 < i < 5 else 2.0
                most_m_s = min(most_m_s, max(rate * (range_m - 0.03), 0.0) + 0.03)
        for i in range(SONARS):
            range_m = ring.range_m[i]
            if range_m is not None and range_m < 0.08:
                closing = 0.25 * cos(max(abs(BEARINGS[i]) - HALF_CONE, 0.0))
                least = CRAWL_M_S if i in (0, 1, 6, 7) and range_m > 0.015 else 0.0
                most_m_s = min(most_m_s, max(max(range_m - 0.025, 0.0) / closing, least))
    most_m_s = min(most_m_s, 0.9 * headings.free_ahead(memory.sectors, pose.heading_rad, params))
    if error_rad != 0.0:
        cosine = max(cos(error_rad), 0.0)
        most_m_s *= cosine * cosine
    return most_m_s
