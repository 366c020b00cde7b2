"""`teleop`: drive by hand in MANUAL."""

from ground.client.connection import LONGEST_S, within
from ground.client.outcomes import Answer, DriveEnded
from ground.commands.command import OperatorCommand, command, option, place, seconds
from ground.robot import FASTEST_DEG_S, FASTEST_M_S, Robot
from protocol.options import finite
from runtime.cli.verb import DRIVE
from runtime.errors import UserError


@command(DRIVE, 150, "teleop 0.2 15 --for 3", moves=True, begins=True)
class DriveByHand(OperatorCommand):
    """Drive by hand at a speed and a turn.

    Ends after `for_s` or when it is interrupted; then the robot holds.
    """

    speed_m_s: float = place("SPEED", "m/s, negative: backwards", parse=finite)
    turn_deg_s: float = place("YAW_DEG_S", "deg/s, positive: left", parse=finite)
    for_s: float | None = option(
        "--for", default=None, parse=seconds, metavar="S", help="stop after this time"
    )

    def __post_init__(self) -> None:
        within(self.speed_m_s, -FASTEST_M_S, FASTEST_M_S, "speed", "m/s")
        within(self.turn_deg_s, -FASTEST_DEG_S, FASTEST_DEG_S, "turn", "deg/s")
        if self.for_s is not None:
            within(self.for_s, 0.0, LONGEST_S, "time", "s")

    async def perform(self, robot: Robot) -> Answer | DriveEnded:
        """Drive; UserError without `for_s` if another part of the process commands the robot."""
        if not robot.follows and self.for_s is None:
            raise UserError(
                "--for S is missing: teleop SPEED YAW_DEG_S --for S; or teleop for the keys"
            )
        return await robot.drive(self.speed_m_s, self.turn_deg_s, for_s=self.for_s)
