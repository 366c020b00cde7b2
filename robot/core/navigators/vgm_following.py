"""Follow an obstacle on a latched side, by its stored echoes.

A closed chain of echoes either proves that the boundary separates robot and goal, or shows an
island. A loop without a closed chain proves nothing: the other side is tried with smaller margins,
and after several such loops the robot is lost. If a long straight path only leads away from the
goal, the other side is tried, too.

Headings and turns without a unit in their names are brads: integers, 4096 to the circle.
"""

from math import inf
from typing import Final

from robot.core import states
from robot.core.navigators import look_around, loops, open_headings
from robot.core.navigators import proof as proofs
from robot.core.navigators.evasion import Evasion, FlankWalker
from robot.core.navigators.loops import Loops
from robot.core.navigators.open_headings import Sectors
from robot.core.navigators.pace import Held
from robot.core.navigators.proof import Proof
from robot.core.perception import echoes as echo_memory
from robot.core.perception.echoes import (
    BRADS,
    CIRCLE,
    HALF_CIRCLE,
    NOTHING,
    QUARTER,
    SURE,
    Echoes,
)
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Pose
from runtime.elementary import atan2

STEP_M: Final = 0.10  # following ends where the remaining distance is this much shorter than ever
FAR_M: Final = 3.0
ROOM_PER_BRAD: Final = 1.0 / 800.0  # metres of room that make up for one brad of rotation
RIGHT_SONARS: Final = (0, 1, 2, 3)
LEFT_SONARS: Final = (4, 5, 6, 7)
SOFT: Final = 455  # 40 degrees: largest detour for a wide margin
SHARP: Final = 796  # 70 degrees: on a sharper turn the followed point is kept
WIDE_TURN: Final = 400  # 35 degrees: before a larger turn, gaps without a margin are tried
HELD_MM: Final = 120  # an echo must be stored this near to the followed point
LOST_MM: Final = 600  # no echo farther away replaces the followed point
EASE_MM: Final = 20  # subtracted from all margins after a closed loop
AGAIN_CM: Final = 30  # a new hit this near to the last leave keeps the side
PATIENCE_CM: Final = 150  # distance driven on a side that leads away; doubles per island
AWAY: Final = 1.15  # leads away: beyond this factor of the hit's distance, plus AWAY_M
AWAY_M: Final = 0.2
ISLANDS: Final = 10  # lost after more islands
ABOUT: Final = 1251  # 110 degrees: a larger turn is made away from the boundary
STRAIGHT: Final = 170  # 15 degrees: maximum heading error at which a proof may begin
MARK_AFTER: Final = 2  # points of the path before a proof begins
MAX_LOOPS: Final = 4  # lost after so many loops along boundaries with gaps
DWELL: Final = 80  # choices, twelve seconds, near one point of the path; then it looks around
AT_FIRST: Final = 2  # so much counts a choice near the first point
SHUT: Final = 4  # and one without an open heading
LOOKS: Final = -1
MIDDLE: Final = -2
MAX_DRIVE: Final = 60  # choices on the way to the middle of the place


class VgmMemory:
    """State of the navigator; `side` is where the followed obstacle is passed.

    `following` is set while one is followed, and `anchor_*` is the place of the followed echo.
    `best_m` is the shortest distance to the goal so far, `left_m` that at the last leave,
    `left_place` the place of it, `hit_m` the distance at the last hit. `failed_leaves` counts
    leaves without progress. `aside` is the side of the last small detour, kept for `aside_ticks`
    choices. `passed` holds the number of changes of side and the last side (`changes`).
    `reversed` is set once the side was changed because the path only led away from the goal.

    `awaits_proof` is set until one loop has been ignored because its proof might still close.
    `open_loops` counts the loops that were not, `islands` the islands left. After an open loop
    `ease_mm` is subtracted from all margins. `given_up` is set by a proof, `lost` if the robot has
    found neither a path nor a proof.

    `heading` is the last choice, `rotation` its angle from the goal's direction. `held` are the
    ranges that limit the speed (`pace`). `dwell` counts the choices near one point of the path, by
    their weight. It is LOOKS or MIDDLE while the robot turns there to look around,
    and less on the way to the middle. `still` counts the choices near `still_*_mm`. `phase` selects
    the work of a tick; `before` is the pose one tick ago.
    """

    __slots__ = (
        "anchor_x_mm",
        "anchor_y_mm",
        "aside",
        "aside_ticks",
        "awaits_proof",
        "before",
        "best_m",
        "dwell",
        "ease_mm",
        "echoes",
        "evasion",
        "failed_leaves",
        "flank_walker",
        "following",
        "given_up",
        "goal_x_m",
        "goal_y_m",
        "heading",
        "held",
        "hit_m",
        "islands",
        "left_m",
        "left_place",
        "loops",
        "lost",
        "open_loops",
        "passed",
        "phase",
        "proof",
        "reversed",
        "rotation",
        "sectors",
        "side",
        "still",
        "still_x_mm",
        "still_y_mm",
    )

    def __init__(self) -> None:
        self.echoes = Echoes()
        self.sectors = Sectors()
        self.loops = Loops()
        self.proof = Proof()
        self.flank_walker = FlankWalker()
        self.evasion = Evasion()
        self.side: int = states.LEFT
        self.goal_x_m = self.goal_y_m = inf
        self.before: Pose | None = None
        self.phase = 0
        self.heading = self.rotation = 0
        self.held = Held()
        self.anchor_x_mm = self.anchor_y_mm = 0
        self.left_place = self.passed = 0
        self.aside = self.aside_ticks = 0
        self.still = self.still_x_mm = self.still_y_mm = 0
        self.following = self.given_up = self.lost = self.awaits_proof = self.reversed = False
        self.best_m = self.left_m = self.hit_m = inf
        self.failed_leaves = self.islands = self.open_loops = self.dwell = self.ease_mm = 0


def begin(memory: VgmMemory) -> None:
    """Reset for a new goal; the echoes stay valid."""
    memory.best_m = memory.left_m = memory.hit_m = inf
    memory.following = memory.given_up = memory.lost = memory.awaits_proof = memory.reversed = False
    memory.open_loops = memory.rotation = memory.passed = 0
    memory.failed_leaves = memory.islands = memory.dwell = memory.ease_mm = 0
    memory.loops.hits = 0
    loops.restart(memory.loops)
    proofs.void(memory.proof)


def hit(
    memory: VgmMemory, ring: Ring, x_cm: int, y_cm: int, to_goal: int, distance_m: float
) -> None:
    """Latch the side with more room and the smaller rotation, unless it was tried here before."""
    sectors = memory.sectors
    memory.following = True
    memory.dwell = 0
    closing = open_headings.closer(sectors, to_goal, sectors.tight)
    if closing != NOTHING:
        hold(memory, closing)
    if memory.best_m < memory.left_m - STEP_M:
        memory.failed_leaves = 0
    elif memory.left_m < inf:
        memory.failed_leaves += 1
        place = memory.left_place
        if loops.is_near(loops.x_of(place) - x_cm, loops.y_of(place) - y_cm, AGAIN_CM):
            return
    left = open_headings.sweep(sectors, to_goal, states.LEFT, sectors.tight)
    right = open_headings.sweep(sectors, to_goal, states.RIGHT, sectors.tight)
    more = ROOM_PER_BRAD * (right - left) + room_m(ring, LEFT_SONARS) - room_m(ring, RIGHT_SONARS)
    wanted = states.LEFT if more >= 0.0 else states.RIGHT
    wanted = loops.side_at(memory.loops, x_cm, y_cm, wanted)
    memory.side = loops.kept(memory.passed, wanted, loops.MAX_CHANGES)
    loops.remember(memory.loops, x_cm, y_cm, memory.side)
    memory.hit_m = distance_m
    memory.reversed = memory.reversed and memory.failed_leaves > 0
    restart(memory)
    memory.heading = to_goal + memory.side * (left if memory.side == states.LEFT else right)


def room_m(ring: Ring, sonars: "tuple[int, ...]") -> float:
    """Return the sum of the ranges of some sonars, each at most FAR_M; a missing one adds none."""
    room_m = 0.0
    for i in sonars:
        range_m = ring.range_m[i]
        if range_m is not None:
            room_m += range_m if range_m < FAR_M else FAR_M
    return room_m


def restart(memory: VgmMemory) -> None:
    """Start the path, and with the next choice the proof, on another side or boundary."""
    loops.restart(memory.loops)
    proofs.void(memory.proof)
    memory.awaits_proof = True


def hold(memory: VgmMemory, sector: int) -> None:
    """Follow the point of this sector from now on."""
    if sector != NOTHING:
        k = memory.sectors.point[sector]
        if k != NOTHING:
            memory.anchor_x_mm = memory.echoes.x_mm[k]
            memory.anchor_y_mm = memory.echoes.y_mm[k]


def follow(memory: VgmMemory, pose: Pose, distance_m: float) -> None:
    """Take the first open heading from the followed point on, on the latched side."""
    if memory.dwell < 0:
        look_round(memory, pose, distance_m)
        return
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    if not is_held(memory) and not regain(memory, x_mm, y_mm):
        memory.following = False
        return
    start = int(BRADS * atan2(memory.anchor_y_mm - y_mm, memory.anchor_x_mm - x_mm))
    heading = int(BRADS * pose.heading_rad)
    turn = open_turn(memory, start, heading)
    if turn >= CIRCLE:
        memory.heading = heading + memory.side * QUARTER
        stay(memory, pose, SHUT)
        return
    memory.heading = start + memory.side * turn
    off = (memory.heading - heading + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    if off * memory.side < -ABOUT:
        # Turn away from the boundary: so the sonars of the followed flank sweep over it.
        memory.heading = heading + memory.side * QUARTER
    if -SHARP < off < SHARP:
        # On a sharp turn the point is kept: the sonars may still see an opening past it.
        hold(memory, memory.sectors.closing)
    points = memory.loops.count
    closed = loops.drop(memory.loops, x_mm // 10, y_mm // 10, heading)
    if memory.loops.count != points or memory.loops.spacing_cm > loops.SPACING_CM:
        memory.dwell = 0
    elif stay(memory, pose, 1 if points >= MARK_AFTER else AT_FIRST):
        return
    found = prove(memory, pose, off)
    if found == proofs.SEPARATED:
        memory.given_up = True
    elif found == proofs.DOUBTED:
        try_other_side(memory, 2)
    elif found == proofs.AROUND:
        leave_island(memory)
    elif closed:
        close_loop(memory)
    elif is_astray(memory, distance_m):
        memory.reversed = True
        memory.side = -memory.side
        restart(memory)


def watch_boundary(memory: VgmMemory, pose: Pose, ring: Ring, radius_mm: int) -> None:
    """Continue the chain of the proof by the scan of this tick."""
    proof = memory.proof
    proofs.look(proof.chain, ring, memory.before or pose, pose, radius_mm)
    if memory.dwell == LOOKS or memory.dwell == MIDDLE:
        look_around.watch(proof, memory.loops, pose, radius_mm)
    if proof.is_valid:
        proofs.continue_chain(proof, memory.side, radius_mm, memory.goal_x_m, memory.goal_y_m)
        if not proof.is_valid:
            begin_beyond(memory)


def begin_beyond(memory: VgmMemory) -> None:
    """Begin another lap on the surface beyond the gap, as this one does not separate from the goal.

    It counts as a loop, so that it does not go on for ever.
    """
    memory.open_loops += 1
    memory.lost = memory.open_loops >= MAX_LOOPS
    memory.awaits_proof = True


def prove(memory: VgmMemory, pose: Pose, off: int) -> int:
    """Continue the proof by one choice, or begin it here; return what it proves.

    It begins where the robot drives along the boundary, not where it still turns at the hit.
    """
    proof = memory.proof
    if not proof.is_valid:
        if -STRAIGHT < off < STRAIGHT and memory.loops.count >= MARK_AFTER:
            proofs.mark(proof, pose, memory.side, memory.goal_x_m, memory.goal_y_m)
        return proofs.OPEN
    proofs.advance(proof, pose, memory.goal_x_m, memory.goal_y_m)
    return proofs.verdict(proof, memory.side)


def open_turn(memory: VgmMemory, start: int, heading: int) -> int:
    """Return the turn from the followed point to an open heading.

    A wide margin is used where the detour is small, else the middle of the gap. Before turning
    back, a gap without a margin is tried.
    """
    sectors, side = memory.sectors, memory.side
    halves = sectors.tight
    turn = open_headings.sweep(sectors, start, side, halves)
    closing = sectors.closing
    off = (start + side * turn - heading + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    if turn >= CIRCLE or not -WIDE_TURN < off < WIDE_TURN:
        open_headings.squeeze(sectors)
        squeezed = open_headings.open_from(sectors, sectors.squeezed, 0, turn - SOFT)
        if squeezed < turn - SOFT:
            turn, closing = squeezed, sectors.closing
            halves = sectors.squeezed
    if halves is sectors.tight and turn < CIRCLE:
        wide = open_headings.open_from(sectors, sectors.wide, turn, turn + SOFT)
        if wide < turn + SOFT:
            sectors.closing = closing
            return wide
    sectors.closing = closing
    if turn >= CIRCLE:
        return CIRCLE
    beyond = open_headings.room(sectors, turn, halves) // 2
    return turn + (beyond if beyond < SOFT else SOFT)


def stay(memory: VgmMemory, pose: Pose, choices: int) -> bool:
    """Count choices near one point of the path; return whether the robot looks around now."""
    memory.dwell += choices
    if memory.dwell <= DWELL:
        return False
    memory.dwell = LOOKS
    look_around.begin(memory.proof, memory.loops, pose)
    return True


def look_round(memory: VgmMemory, pose: Pose, distance_m: float) -> None:
    """Turn once round on the spot, then in the middle; give up if there is no way out.

    Else drop all echoes: the robot has been kept here by some that are false or old.
    """
    proof, path = memory.proof, memory.loops
    if memory.dwell < MIDDLE:
        memory.dwell += 1
        memory.heading = proof.goal_angle
        if memory.dwell == MIDDLE or look_around.moved_mm(proof, pose) >= proof.way_mm:
            memory.dwell = MIDDLE
            look_around.begin(proof, path, pose)
        return
    memory.heading = int(BRADS * pose.heading_rad) + memory.side * QUARTER
    if not look_around.is_round(proof):
        return
    if look_around.is_shut(proof, path) and look_around.is_outside(proof, distance_m):
        proof.closed += 1
        memory.given_up = proof.closed >= look_around.ROUNDS
        look_around.new_round(proof, path)
        return
    echo_memory.clear(memory.echoes)
    if memory.dwell == LOOKS:
        memory.dwell = MIDDLE - MAX_DRIVE
        look_around.to_middle(proof, path)
    elif proof.way_mm > 0:
        proof.way_mm = 0  # one more round: false echoes may have opened this one
        look_around.new_round(proof, path)
    else:
        memory.dwell = 0
        memory.following = False
        restart(memory)


def is_astray(memory: VgmMemory, distance_m: float) -> bool:
    """Return whether a long straight path on this side has only led away from the goal.

    The other side is then tried, once for each obstacle. Within a bend the path out of a trap leads
    away at first, too.
    """
    return (
        not memory.reversed
        and loops.are_left(memory.passed)
        and loops.walked_cm(memory.loops) >= PATIENCE_CM << memory.islands
        and loops.is_straight(memory.loops)
        and distance_m > AWAY * memory.hit_m + AWAY_M
    )


def close_loop(memory: VgmMemory) -> None:
    """Handle a closed loop without a proof: an island, or a boundary with gaps.

    While the lap may still prove something, its chain should close soon as well, so one loop is
    ignored. Else the other direction is tried with smaller margins, which may lead through a gap.
    """
    path = memory.loops
    if memory.awaits_proof and proofs.may_close(memory.proof):
        memory.awaits_proof = False
        loops.restart(path)
        return
    island = loops.turns_left(path) != (memory.side == states.LEFT)
    inside = loops.encloses(path, int(100.0 * memory.goal_x_m), int(100.0 * memory.goal_y_m))
    if island != inside:
        leave_island(memory)
        return
    try_other_side(memory, 1)


def try_other_side(memory: VgmMemory, weight: int) -> None:
    """Follow the boundary in the other direction with smaller margins; in the end be lost.

    After the last change of side the margins alone become smaller.
    """
    restart(memory)
    memory.open_loops += weight
    memory.lost = memory.open_loops >= MAX_LOOPS
    memory.side = loops.kept(memory.passed, -memory.side, loops.MAX_CHANGES)
    memory.ease_mm = EASE_MM


def leave_island(memory: VgmMemory) -> None:
    """Head for the goal again, from a boundary that does not separate it from the robot."""
    restart(memory)
    memory.islands += 1
    memory.best_m = memory.left_m = inf
    memory.following = False
    memory.lost = memory.islands > ISLANDS


def is_held(memory: VgmMemory) -> bool:
    """Return whether an echo is still stored near the followed point."""
    low_x, high_x = memory.anchor_x_mm - HELD_MM, memory.anchor_x_mm + HELD_MM
    low_y, high_y = memory.anchor_y_mm - HELD_MM, memory.anchor_y_mm + HELD_MM
    echoes = memory.echoes
    xs, ys = echoes.x_mm, echoes.y_mm
    for k in range(echoes.count):
        if low_x < xs[k] < high_x and low_y < ys[k] < high_y and echoes.weight[k] >= SURE:
            return True
    return False


def regain(memory: VgmMemory, x_mm: int, y_mm: int) -> bool:
    """Follow the nearest stored echo instead; return False if there is none."""
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
