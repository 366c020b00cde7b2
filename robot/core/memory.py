"""What a navigator may remember between ticks; every navigator is given the same kind."""

from robot.core import states


class Memory:
    """`side` is where obstacles are passed, `following` whether one is being followed, `lost_rad`
    how far the robot has turned since it lost the followed wall, `heading_rad` its last heading."""

    __slots__ = ("following", "heading_rad", "lost_rad", "side")

    def __init__(self) -> None:
        self.side: int = states.LEFT
        self.following = False
        self.lost_rad = 0.0
        self.heading_rad = 0.0
