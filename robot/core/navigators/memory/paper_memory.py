"""The memory of the paper's navigators; vgm uses only the side."""

from robot.core import states


class Memory:
    """State of bug between two ticks.

    `side` is where obstacles are passed. `following` is set while one is followed, and `beside`
    once it is beside the robot. `lost_rad` is the turn since the wall was lost, `heading_rad` the
    last heading.
    """

    __slots__ = ("beside", "following", "heading_rad", "lost_rad", "side")

    def __init__(self) -> None:
        self.side: int = states.LEFT
        self.following = False
        self.beside = False
        self.lost_rad = 0.0
        self.heading_rad = 0.0
