"""/cmd_vel: drives by hand, under the lease, that end half a second after the last command.

A command that is not a number, or older than the time-out, is refused; one that is too fast is
clamped. While one node sends, those of another are refused: two sources would steer in turns.
A command of zero speed begins no drive, and none interrupts a goal.
"""

import asyncio
import time
from collections.abc import Callable
from math import isfinite
from typing import Any, Final

from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticStatus as Part

from gateways.ros2.report import Reporter
from gateways.ros2.wire import Attachment
from ground.client.leases import TICK_NS
from ground.client.outcomes import Refused
from ground.robot import Robot, Speeds
from ground.ros2.messages import RosClock
from protocol.topics import STATUS
from protocol.wire.enums import GoalState, Mode
from runtime.errors import LocalError, RemoteError
from runtime.units import NS_PER_MS, NS_PER_S

TIMEOUT_NS: Final = 500 * NS_PER_MS
AGAIN_NS: Final = NS_PER_S
"""Time after a refusal before the next command asks the robot again."""

GAP_S: Final = 0.01
"""Least time between two commands to the robot: a flood of them is thinned out to the newest."""

TWO_SOURCES: Final = "two nodes publish it, and the robot follows the first one"
GOALS: Final = (
    GoalState.ACCEPTED,
    GoalState.DRIVING,
    GoalState.AVOIDING,
    GoalState.ALIGNING,
)
BY_ITSELF: Final = (Mode.AUTO, Mode.GUIDED, Mode.SMART_RTL)


class VelocityCommands:
    """Steers a robot by what arrives; `limits` are its fastest speed (m/s) and turn (rad/s)."""

    def __init__(
        self,
        robot: Robot,
        clock: RosClock,
        report: Reporter,
        limits: Callable[[], tuple[float, float]],
    ) -> None:
        self._robot, self._clock, self._report, self._limits = robot, clock, report, limits
        self.refusal = ""
        """Why commands move nothing now; empty while they do."""

        self.losers: dict[bytes, int] = {}
        """When commands of a node that does not steer have arrived, by the id of its publisher."""

        self._speeds = (0.0, 0.0)
        self._source = b""
        self._arrived_ns = -TIMEOUT_NS
        self._arrival = asyncio.Event()
        self._drive: asyncio.Task[None] | None = None
        self._again_ns = 0

    @property
    def is_driving(self) -> bool:
        """Whether a drive has begun, or begins."""
        return self._drive is not None and not self._drive.done()

    def take_stamped(self, message: Any, attachment: Attachment) -> None:
        """Take a TwistStamped: its stamp may be zero, or of now, by the time of day or of ROS."""
        stamp_ns = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
        clocks = (time.time_ns(), self._clock.now())
        ages = [now_ns - stamp_ns for now_ns in clocks]
        if stamp_ns and not any(abs(age_ns) <= TIMEOUT_NS for age_ns in ages):
            self._report.warn_once("cmd_vel: refused, its stamp is not of now")
            return
        self.take(message.twist, attachment)

    def take(self, twist: Any, attachment: Attachment) -> None:
        """Take a Twist, of which the robot can follow linear.x and angular.z."""
        now_ns = self._robot.clock.now_ns()
        axes = (twist.linear.x, twist.linear.y, twist.linear.z)
        turns = (twist.angular.x, twist.angular.y, twist.angular.z)
        if not all(map(isfinite, (*axes, *turns))):
            self._report.warn_once("cmd_vel: refused, a value is not a number")
            return
        if self._is_of_another(attachment.gid, now_ns):
            return
        if any((axes[1], axes[2], turns[0], turns[1])):
            self._report.warn_once("cmd_vel: the robot follows only linear.x and angular.z")
        self._speeds = self._clamped(axes[0], turns[2])
        self._source, self._arrived_ns = attachment.gid, now_ns
        self._arrival.set()
        if not self.is_driving and self._speeds != (0.0, 0.0) and now_ns >= self._again_ns:
            self._begin(now_ns)

    def part(self, now_ns: int) -> Part:
        """Return the state of /cmd_vel for /diagnostics; a node that does not steer is named."""
        self.losers = {
            gid: at_ns for gid, at_ns in self.losers.items() if now_ns - at_ns < TIMEOUT_NS
        }
        losers = ", ".join(gid.hex()[:8] for gid in self.losers)
        if losers:
            return self._report.part(1, "cmd_vel", TWO_SOURCES, ignored=losers)
        if self.refusal:
            return self._report.part(1, "cmd_vel", self.refusal)
        return self._report.part(0, "cmd_vel", "drives" if self.is_driving else "no commands")

    async def end(self) -> None:
        """End the drive."""
        if self._drive is not None:
            self._drive.cancel()
            await asyncio.gather(self._drive, return_exceptions=True)

    def _is_of_another(self, gid: bytes, now_ns: int) -> bool:
        """Return whether another node steers, and tell the one that sent this."""
        if gid == self._source or now_ns - self._arrived_ns >= TIMEOUT_NS:
            self.losers.pop(gid, None)
            return False
        if len(self.losers) < 16:
            self.losers[gid] = now_ns
        self._report.warn_once(f"cmd_vel: {TWO_SOURCES}")
        return True

    def _clamped(self, speed_m_s: float, turn_rad_s: float) -> tuple[float, float]:
        fastest_m_s, fastest_rad_s = self._limits()
        found = (
            min(max(speed_m_s, -fastest_m_s), fastest_m_s),
            min(max(turn_rad_s, -fastest_rad_s), fastest_rad_s),
        )
        if found != (speed_m_s, turn_rad_s):
            text = f"clamped to {fastest_m_s:g} m/s and {fastest_rad_s:g} rad/s"
            self._report.warn_once(f"cmd_vel: too fast, {text}")
        return found

    def _begin(self, now_ns: int) -> None:
        newest = self._robot.streams.latest(STATUS)
        if newest is not None and newest[0].goal in GOALS and newest[0].mode in BY_ITSELF:
            self._refuse("a goal is active: cancel it, or call hold", now_ns)
            return
        self._drive = asyncio.get_running_loop().create_task(self._steer())

    async def _steer(self) -> None:
        """Drive until commands cease, or the robot follows another operator."""
        try:
            ended = await self._robot.steer(self._commands())
            why = ended.words if isinstance(ended, Refused) else ended.reason
        except (LocalError, RemoteError) as error:
            why = str(error)
        if why:
            self._refuse(why, self._robot.clock.now_ns())
        else:
            self.refusal = ""

    def _refuse(self, why: str, now_ns: int) -> None:
        self.refusal = why
        self._again_ns = now_ns + AGAIN_NS
        self._report.warn_once(f"cmd_vel: {why}")

    async def _commands(self) -> Speeds:
        """Yield the newest command as it arrives, and again while it holds."""
        clock = self._robot.clock
        while (left_ns := self._arrived_ns + TIMEOUT_NS - clock.now_ns()) > 0:
            self._arrival.clear()
            yield self._speeds
            await asyncio.sleep(GAP_S)
            try:
                async with asyncio.timeout(min(left_ns, TICK_NS) / NS_PER_S - GAP_S):
                    await self._arrival.wait()
            except TimeoutError:
                continue
