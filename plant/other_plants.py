"""The other plants of a world: how their robots move, which tick by tick each tells the others.

Every plant has the discs of all robots and moves them alike, so it needs no part of the world of
its own and no robot ever changes its plant. What a plant must be told of a robot that it does not
simulate is known before the world moves (see `RobotMotion`): one exchange per tick suffices.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final
from zlib import crc32

from plant.sim.simulation import Plant, RobotMotion
from protocol.bus.bus import Bus, Presence
from protocol.topics import MOTION, Role
from protocol.wire.messages import RobotMotion as MotionMessage
from runtime.units import PERIOD_NS, UINT32

KEPT_TICKS: Final = 2
"""Another plant can be one tick ahead: it then waits for this one."""

WORLD: Final = "give all plants the same --world, --seed, --noise and --robots"


class OtherPlants:
    """Tells the motions of the own robots, and takes those of all others; ends with any of them.

    `own` and `others` are the names of robots by number. `notify` is called from the bus whenever
    something has arrived. In `lockstep` only the motions of one tick count together; in wall time
    the newest of each robot.

    A START or PAUSE acts on all plants. Each has a number, and the newest is in force.
    """

    def __init__(
        self,
        bus: Bus,
        own: Mapping[int, str],
        others: Mapping[int, str],
        world: bytes,
        notify: Callable[[], None],
        *,
        lockstep: bool,
    ) -> None:
        self.why_ended = ""
        """Why this plant cannot go on: another one has gone, or simulates another world."""

        self._publishers = {number: bus.publisher(MOTION, robot) for number, robot in own.items()}
        self._others = others
        self._world = crc32(world) & UINT32
        self._notify = notify
        self._lockstep = lockstep
        self._tick = 0
        self._told: dict[int, list[tuple[int, RobotMotion]]] = {}
        """The motions of this plant's robots at the newest ticks."""

        self._of: dict[int, dict[int, RobotMotion]] = {number: {} for number in others}
        """The motions of each other robot by tick."""

        self._sessions: dict[str, frozenset[str]] = dict.fromkeys(others.values(), frozenset())
        self._orders = self._obeyed = 0
        self._running = False
        for number, robot in others.items():
            bus.mailbox(MOTION, robot, check=partial(self._take, number))

    def note_presence(self, token: Presence, appeared: bool) -> None:
        """Note a process that has appeared or disappeared; called by the bus."""
        before = self._sessions.get(token.robot)
        if before is None or token.role != Role.PLANT.value:
            return
        sessions = before | {token.zid} if appeared else before - {token.zid}
        self._sessions[token.robot] = sessions
        if not sessions:
            self._end(f"the plant of {token.robot} has gone: start all plants of this world again")

    def order(self, *, running: bool) -> None:
        """Let all plants run or pause."""
        self._orders, self._running = self._orders + 1, running
        self._obeyed = self._orders
        self.repeat()

    def take_order(self, *, running: bool) -> tuple[bool, bool]:
        """Return whether this plant is to run from now on, and whether with a new score.

        It begins one at a START if it runs, as a plant that is alone does; after a PAUSE that was
        overtaken by that START it goes on.
        """
        new, self._obeyed = self._orders - self._obeyed, self._orders
        if new == 0:
            return running, False
        return self._running, self._running and running and new == 1

    def tell(self, plant: Plant) -> None:
        """Run the wheels of the own robots, and publish how these will move."""
        self._tick = plant.now_ns // PERIOD_NS
        for number, motion in plant.motions().items():
            told = self._told.setdefault(number, [])
            told.append((plant.now_ns, motion))
            del told[:-KEPT_TICKS]
            self._publish(number, plant.now_ns, motion)

    def repeat(self) -> None:
        """Publish again what was told last: another plant may have missed it."""
        for number, told in self._told.items():
            for time_ns, motion in told:
                self._publish(number, time_ns, motion)

    def _publish(self, number: int, time_ns: int, motion: RobotMotion) -> None:
        early, late = motion.legs
        message = MotionMessage(
            time_ns=time_ns,
            x_m=motion.x_m,
            y_m=motion.y_m,
            clearance_m=motion.clearance_m,
            early_x_m_s=early[0],
            early_y_m_s=early[1],
            early_speed_m_s=early[2],
            late_x_m_s=late[0],
            late_y_m_s=late[1],
            late_speed_m_s=late[2],
            world=self._world,
            orders=self._orders,
            running=self._running,
        )
        self._publishers[number].put(message)

    @property
    def silent(self) -> bool:
        """Return whether a motion at the tick that was told last is missing; no in wall time."""
        return self._lockstep and any(self._tick not in of_robot for of_robot in self._of.values())

    def motions(self) -> dict[int, RobotMotion]:
        """Return the motions of the others; in lockstep call it when none is missing."""
        if self._lockstep:
            return {number: of_robot[self._tick] for number, of_robot in self._of.items()}
        newest = {number: tuple(of_robot.values()) for number, of_robot in self._of.items()}
        return {number: motions[-1] for number, motions in newest.items() if motions}

    def _take(self, number: int, message: MotionMessage) -> str:
        """Take a message; return what is wrong with one of another world."""
        robot = self._others[number]
        if message.world != self._world:
            self._end(f"the plant of {robot} simulates another world: {WORLD}")
            return "belongs to another world"
        if message.orders > self._orders:
            self._running, self._orders = message.running != 0, message.orders
        tick = message.time_ns // PERIOD_NS
        if not self._lockstep or tick >= self._tick:
            early = message.early_x_m_s, message.early_y_m_s, message.early_speed_m_s
            late = message.late_x_m_s, message.late_y_m_s, message.late_speed_m_s
            motion = RobotMotion(message.x_m, message.y_m, message.clearance_m, (early, late))
            kept = [(t, one) for t, one in self._of[number].items() if t != tick]
            self._of[number] = dict([*kept[1 - KEPT_TICKS :], (tick, motion)])
        self._notify()
        return ""

    def _end(self, why: str) -> None:
        self.why_ended = self.why_ended or why
        self._notify()


def shared_world(*facts: Any) -> bytes:
    """Return what must be equal in all plants of a world."""
    return repr(facts).encode()
