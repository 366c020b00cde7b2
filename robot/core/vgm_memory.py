"""The Virtual Goal Method with a memory: the goal is turned by the smallest rotation that is open.

What the paper's method lacks is here: the echoes of the last metre are remembered, the side is
latched while an obstacle is followed, following ends only with progress, a way that closes upon
itself reverses the side once, and the second time means that nothing leads to the goal.
"""

from math import atan2, cos, inf, sin, sqrt

from robot.core import echoes as echo_memory
from robot.core import escort as escorts
from robot.core import headings, loops, pace, states
from robot.core import ring as rings
from robot.core.echoes import BRADS, CIRCLE, HALF_CIRCLE, NOTHING, QUARTER, SURE, Echoes
from robot.core.escort import Escort
from robot.core.geometry import wrap
from robot.core.headings import Sectors
from robot.core.loops import Loops
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.typed import Final
from robot.core.values import Decision, Goal, Pose

STEP_M: Final = 0.10
"""Following ends only where the way to go gets shorter than ever by this much."""
NEAR_GOAL_M: Final = 0.6
SOFT: Final = 455  # brads, 40 degrees: so far aside for the sake of a wide margin
SHARP: Final = 796  # 70 degrees: on so sharp a turn the followed point is kept
WIDE_TURN: Final = 400  # 35 degrees: before turning by more, gaps are tried without a margin
SAME_SIDE: Final = 228  # 20 degrees: so much smaller must a rotation be to change the side
HELD_MM: Final = 120
LOST_MM: Final = 600
EASE_MM: Final = 20
AGAIN_CM: Final = 30
PATIENCE_CM: Final = 150
AWAY: Final = 1.15
AWAY_M: Final = 0.2
PROMISES: Final = 2
ISLANDS: Final = 6
SHUT_TICKS: Final = 60
ABOUT: Final = 1365  # 120 degrees
LONG_CM: Final = 1200
LATCH_TICKS: Final = 20
FARTHEST: Final = 1e5  # metres or radians: beyond them, millimetres and brads are no numbers


class Memory:
    """`side` is where the followed obstacle is passed, `anchor` the place of the echo followed.

    `best_m` is the least distance to the goal so far, `left_m` that when it last left an obstacle,
    `hit_m` when it met this one; `broken` counts leaves that did not pay. `aside` is the side of
    the last small detour and `aside_ticks` how long it stays that.
    """

    __slots__ = (
        "anchor_x_mm",
        "anchor_y_mm",
        "aside",
        "aside_ticks",
        "best_m",
        "broken",
        "doubtful",
        "ease_mm",
        "echoes",
        "escort",
        "following",
        "given_up",
        "goal_x_m",
        "goal_y_m",
        "heading",
        "hit_m",
        "islands",
        "left_m",
        "left_x_cm",
        "left_y_cm",
        "loops",
        "proofs",
        "reversed",
        "sectors",
        "shut",
        "side",
        "turned_back",
    )

    def __init__(self) -> None:
        self.echoes = Echoes()
        self.sectors = Sectors()
        self.loops = Loops()
        self.escort = Escort()
        self.side: int = states.LEFT
        self.goal_x_m = self.goal_y_m = inf
        self.heading = 0
        self.anchor_x_mm = self.anchor_y_mm = 0
        self.left_x_cm = self.left_y_cm = 0
        self.aside = self.aside_ticks = 0
        self.following = self.given_up = self.turned_back = self.reversed = False
        self.doubtful = False
        self.best_m = self.left_m = self.hit_m = inf
        self.broken = self.islands = self.proofs = self.shut = self.ease_mm = 0


def begin(memory: Memory) -> None:
    """For a goal of its own; what the echoes told stays true."""
    memory.following = memory.given_up = memory.turned_back = memory.reversed = False
    memory.best_m = memory.left_m = memory.hit_m = inf
    memory.doubtful = False
    memory.proofs = 0
    memory.broken = memory.islands = memory.shut = memory.ease_mm = 0
    memory.loops.hits = 0
    loops.restart(memory.loops)


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Where to drive now, and how fast at most; GIVE_UP when no way leads to the goal."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    distance_m = sqrt(dx_m * dx_m + dy_m * dy_m)
    if not is_somewhere(pose, distance_m):
        return Decision(states.TO_GOAL, None, ring.nearest_m, 0.0, 0.0, goal.x_m, goal.y_m, 0.0)
    if goal.x_m != memory.goal_x_m or goal.y_m != memory.goal_y_m:
        memory.goal_x_m, memory.goal_y_m = goal.x_m, goal.y_m
        begin(memory)
    goal_rad = atan2(dy_m, dx_m)
    to_goal = int(BRADS * goal_rad)
    heading = int(BRADS * pose.heading_rad)
    memory.heading = to_goal
    radius_mm = int(1000.0 * params.radius_m)
    echo_memory.update(memory.echoes, pose, ring, radius_mm)
    headings.measure(memory.sectors, memory.echoes, pose, ring, memory.ease_mm, radius_mm)
    if escorts.watch(memory.escort, ring, int(1000.0 * pose.x_m), int(1000.0 * pose.y_m), heading):
        memory.following = False
        echo_memory.clear(memory.echoes)
    if memory.escort.ticks > 0:
        give_way(memory)
    elif memory.sectors.count or memory.following:
        choose(memory, pose, ring, to_goal, distance_m, params)
    if distance_m < memory.best_m:
        memory.best_m = distance_m
    return decision(memory, pose, ring, goal_rad, dx_m, dy_m, params)


def is_somewhere(pose: Pose, distance_m: float) -> bool:
    """Whether these are numbers that a robot's place can have; NaN and infinity are not."""
    return (
        distance_m < FARTHEST
        and -FARTHEST < pose.x_m < FARTHEST
        and -FARTHEST < pose.y_m < FARTHEST
        and -FARTHEST < pose.heading_rad < FARTHEST
    )


def give_way(memory: Memory) -> None:
    """Away from who walks alongside, where that is open, and wait until he has gone ahead."""
    sectors, escort = memory.sectors, memory.escort
    escort.ticks -= 1
    left = headings.sweep(sectors, escort.heading, states.LEFT, sectors.tight)
    right = headings.sweep(sectors, escort.heading, states.RIGHT, sectors.tight)
    memory.aside, turn = (states.LEFT, left) if left <= right else (states.RIGHT, right)
    memory.heading = escort.heading + memory.aside * turn


def choose(
    memory: Memory, pose: Pose, ring: Ring, to_goal: int, distance_m: float, params: Params
) -> None:
    """Go on following or leave; go straight, a little aside, or begin to follow."""
    x_cm, y_cm = int(100.0 * pose.x_m), int(100.0 * pose.y_m)
    if memory.following and leaves(memory, pose, ring, to_goal, distance_m, params):
        leave(memory, x_cm, y_cm)
    if not memory.following and closes(memory, pose, to_goal, distance_m, params):
        hit(memory, x_cm, y_cm, to_goal, distance_m)
    if memory.following:
        follow(memory, pose, distance_m)


def closes(memory: Memory, pose: Pose, to_goal: int, distance_m: float, params: Params) -> bool:
    """Whether something stands in the way to the goal; what is only near it is passed aside."""
    sectors = memory.sectors
    if headings.closer(sectors, to_goal, sectors.wide) == NOTHING:
        return False
    if distance_m < NEAR_GOAL_M and is_clear(memory, pose, to_goal, distance_m, params):
        return False
    closing = headings.closer(sectors, to_goal, sectors.tight)
    if closing != NOTHING and sectors.point[closing] != NOTHING:
        return True
    turn_aside(memory, to_goal, SOFT if closing == NOTHING else HALF_CIRCLE)
    return False


def turn_aside(memory: Memory, to_goal: int, most: int) -> None:
    """The smallest rotation with a wide margin, if it is small; the side is kept for a while."""
    sectors = memory.sectors
    left = headings.sweep(sectors, to_goal, states.LEFT, sectors.wide)
    right = headings.sweep(sectors, to_goal, states.RIGHT, sectors.wide)
    if memory.aside_ticks > 0:
        memory.aside_ticks -= 1
        if memory.aside == states.LEFT:
            right += SAME_SIDE
        else:
            left += SAME_SIDE
    side, turn = (states.LEFT, left) if left <= right else (states.RIGHT, right)
    if turn < most:
        memory.aside, memory.aside_ticks = side, LATCH_TICKS
        memory.heading = to_goal + side * turn


def hit(memory: Memory, x_cm: int, y_cm: int, to_goal: int, distance_m: float) -> None:
    """Latch the side of the smaller rotation, but not the one tried at this place before."""
    sectors = memory.sectors
    memory.following = True
    memory.shut = 0
    if memory.best_m < memory.left_m - STEP_M:
        memory.broken = 0
    elif memory.left_m < inf:
        memory.broken += 1
        if loops.is_near(memory.left_x_cm - x_cm, memory.left_y_cm - y_cm, AGAIN_CM):
            hold(memory, headings.closer(sectors, to_goal, sectors.tight))
            return
    left = headings.sweep(sectors, to_goal, states.LEFT, sectors.tight)
    right = headings.sweep(sectors, to_goal, states.RIGHT, sectors.tight)
    wanted = states.LEFT if left <= right else states.RIGHT
    memory.side = loops.side_at(memory.loops, x_cm, y_cm, wanted)
    loops.remember(memory.loops, x_cm, y_cm, memory.side)
    memory.hit_m = distance_m
    memory.reversed = memory.reversed and memory.broken > 0
    memory.doubtful = False
    hold(memory, headings.closer(sectors, to_goal, sectors.tight))


def hold(memory: Memory, sector: int) -> None:
    """Follow the point of this sector from now on."""
    if sector != NOTHING:
        k = memory.sectors.point[sector]
        if k != NOTHING:
            memory.anchor_x_mm = memory.echoes.x_mm[k]
            memory.anchor_y_mm = memory.echoes.y_mm[k]


def follow(memory: Memory, pose: Pose, distance_m: float) -> None:
    """Along the obstacle: the first open heading from the followed point, on the latched side."""
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    if not is_held(memory) and not regain(memory, x_mm, y_mm):
        memory.following = False
        return
    start = int(BRADS * atan2(memory.anchor_y_mm - y_mm, memory.anchor_x_mm - x_mm))
    heading = int(BRADS * pose.heading_rad)
    turn = open_turn(memory, start, heading)
    if turn >= CIRCLE:
        shut_in(memory, heading)
        return
    memory.shut = 0
    memory.heading = start + memory.side * turn
    off = (memory.heading - heading + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    if not -ABOUT < off < ABOUT:
        memory.doubtful = True
    if -SHARP < off < SHARP:
        # Before that the same point is kept: on the turn the sonars may still see a way past it.
        hold(memory, memory.sectors.closing)
    if loops.drop(memory.loops, x_mm // 10, y_mm // 10, heading):
        come_round(memory)
    elif is_astray(memory, distance_m):
        memory.reversed = True
        memory.doubtful = False
        memory.side = -memory.side
        loops.restart(memory.loops)


def open_turn(memory: Memory, start: int, heading: int) -> int:
    """How far to turn from the followed point: with a wide margin where that costs little, else in
    the middle of what is open, and through a gap without a margin before turning back."""
    sectors, side = memory.sectors, memory.side
    halves = sectors.tight
    turn = headings.sweep(sectors, start, side, halves)
    closing = sectors.closing
    off = (start + side * turn - heading + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    if turn >= CIRCLE or not -WIDE_TURN < off < WIDE_TURN:
        headings.squeeze(sectors)
        squeezed = headings.open_from(sectors, sectors.squeezed, 0, turn - SOFT)
        if squeezed < turn - SOFT:
            turn, closing = squeezed, sectors.closing
            halves = sectors.squeezed
    if halves is sectors.tight and turn < CIRCLE:
        wide = headings.open_from(sectors, sectors.wide, turn, turn + SOFT)
        if wide < turn + SOFT:
            sectors.closing = closing
            return wide
    sectors.closing = closing
    if turn >= CIRCLE:
        return CIRCLE
    beyond = headings.room(sectors, turn, halves) // 2
    return turn + (beyond if beyond < SOFT else SOFT)


def shut_in(memory: Memory, heading: int) -> None:
    """Every heading is closed: look round on the spot, and in the end believe none of it."""
    memory.shut += 1
    memory.heading = heading + memory.side * QUARTER
    if memory.shut > SHUT_TICKS:
        echo_memory.clear(memory.echoes)
        memory.shut = 0
        memory.following = False


def is_astray(memory: Memory, distance_m: float) -> bool:
    """Whether it has gone on for long on this side, and only away from the goal: then the other
    side is tried, once for each obstacle."""
    return (
        not memory.reversed
        and loops.walked_cm(memory.loops) >= PATIENCE_CM
        and distance_m > AWAY * memory.hit_m + AWAY_M
    )


def come_round(memory: Memory) -> None:
    """The way has closed upon itself. Where the loop does not keep robot and goal apart it was an
    island: go for the goal again. Where it does, that proves that no way leads there, unless the
    robot turned about on it, as in a dead end: then again, the other way round."""
    way = memory.loops
    memory.proofs += 1 if memory.doubtful else 2
    needed = 3 if memory.doubtful and loops.walked_cm(way) > LONG_CM else 2
    island = loops.turns_left(way) != (memory.side == states.LEFT)
    inside = loops.encloses(way, int(100.0 * memory.goal_x_m), int(100.0 * memory.goal_y_m))
    loops.restart(way)
    memory.doubtful = False
    if island != inside:
        memory.islands += 1
        memory.best_m = memory.left_m = inf
        memory.following = False
        memory.given_up = memory.islands > ISLANDS
        memory.proofs = 0
    elif memory.proofs >= needed:
        memory.given_up = True
    else:
        memory.turned_back = True
        memory.side = -memory.side
        memory.ease_mm = EASE_MM


def is_held(memory: Memory) -> bool:
    """Whether an echo is still remembered where the followed one was."""
    low_x, high_x = memory.anchor_x_mm - HELD_MM, memory.anchor_x_mm + HELD_MM
    low_y, high_y = memory.anchor_y_mm - HELD_MM, memory.anchor_y_mm + HELD_MM
    echoes = memory.echoes
    xs, ys = echoes.x_mm, echoes.y_mm
    for k in range(echoes.count):
        if low_x < xs[k] < high_x and low_y < ys[k] < high_y and echoes.weight[k] >= SURE:
            return True
    return False


def regain(memory: Memory, x_mm: int, y_mm: int) -> bool:
    """Follow the nearest remembered echo instead."""
    echoes = memory.echoes
    best, least = NOTHING, LOST_MM * LOST_MM
    for k in range(echoes.count):
        dx_mm, dy_mm = echoes.x_mm[k] - x_mm, echoes.y_mm[k] - y_mm
        square = dx_mm * dx_mm + dy_mm * dy_mm
        if square < least and echoes.weight[k] >= SURE:
            best, least = k, square
    if best == NOTHING:
        return False
    memory.anchor_x_mm, memory.anchor_y_mm = echoes.x_mm[best], echoes.y_mm[best]
    return True


def leaves(
    memory: Memory, pose: Pose, ring: Ring, to_goal: int, distance_m: float, params: Params
) -> bool:
    """Whether the way to the goal is open and leads nearer to it than ever (DistBug's rule). What
    the sonars promise counts only while such promises are kept."""
    if distance_m < NEAR_GOAL_M and is_clear(memory, pose, to_goal, distance_m, params):
        return True
    sectors = memory.sectors
    if headings.closer(sectors, to_goal, sectors.wide) != NOTHING:
        return False
    free_m = 0.0
    if memory.broken < PROMISES:
        alpha_rad = wrap(to_goal / BRADS - pose.heading_rad)
        free_m = pace.free_towards(ring, alpha_rad, distance_m, params)
    return distance_m - free_m <= memory.best_m - STEP_M


def leave(memory: Memory, x_cm: int, y_cm: int) -> None:
    memory.following = False
    memory.left_m = memory.best_m
    memory.left_x_cm, memory.left_y_cm = x_cm, y_cm


def is_clear(memory: Memory, pose: Pose, to_goal: int, distance_m: float, params: Params) -> bool:
    """Whether no remembered echo touches the straight way to a near goal, without any margin."""
    echoes = memory.echoes
    along_x, along_y = int(1024.0 * cos(to_goal / BRADS)), int(1024.0 * sin(to_goal / BRADS))
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    length_mm, radius_mm = int(1000.0 * distance_m), int(1000.0 * params.radius_m)
    for k in range(echoes.count):
        dx_mm, dy_mm = echoes.x_mm[k] - x_mm, echoes.y_mm[k] - y_mm
        along_mm = dx_mm * along_x + dy_mm * along_y >> 10
        aside_mm = dy_mm * along_x - dx_mm * along_y >> 10
        body_mm = radius_mm - (headings.DOUBT * echoes.spread_mm[k] >> 2)
        if along_mm < 0 or not -body_mm < aside_mm < body_mm or echoes.weight[k] < SURE:
            continue
        past_mm = along_mm - length_mm
        if past_mm <= 0 or past_mm * past_mm + aside_mm * aside_mm < body_mm * body_mm:
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
    alpha_rad = wrap(goal_rad - pose.heading_rad)
    turned = memory.heading - int(BRADS * goal_rad)
    gamma_rad = 0.0 if turned == 0 else wrap(turned / BRADS)
    branch: int = states.TO_GOAL
    if memory.given_up:
        branch = states.GIVE_UP
    elif memory.following:
        branch = states.PASS_LEFT if memory.side == states.LEFT else states.PASS_RIGHT
    elif turned != 0:
        branch = states.PASS_LEFT if memory.aside == states.LEFT else states.PASS_RIGHT
    off_rad = pace.keep_off(ring)
    if off_rad != 0.0:
        gamma_rad = wrap(gamma_rad + off_rad)
    error_rad = wrap(alpha_rad + gamma_rad)
    speed_m_s = pace.speed(ring, memory.sectors.free_mm, error_rad, params)
    if 0 < memory.escort.ticks < escorts.GIVE_WAY_TICKS - escorts.DRIVE_TICKS:
        speed_m_s = 0.0
    cosine, sine = cos(gamma_rad), sin(gamma_rad)
    return Decision(
        branch,
        rings.bearing_rad(ring),
        ring.nearest_m,
        alpha_rad,
        gamma_rad,
        pose.x_m + cosine * dx_m - sine * dy_m,
        pose.y_m + sine * dx_m + cosine * dy_m,
        speed_m_s,
    )
