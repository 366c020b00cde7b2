"""What the navigators of the paper remember between ticks: bug a little, vgm nothing."""

from robot.core import states


class Memory:
    """`side` is where obstacles are passed, `following` whether one is being followed, `beside`
    whether it has come to be beside the robot, `lost_rad` how far the robot has turned since it
    lost it, `heading_rad` the robot's last heading."""

    __slots__ = ("beside", "following", "heading_rad", "lost_rad", "side")

    def __init__(self) -> None:
        self.side: int = states.LEFT
        self.following = False
        self.beside = False
        self.lost_rad = 0.0
        self.heading_rad = 0.0
