"""The topics of ROS 2 that show a robot, with their types and quality of service."""

import re
from dataclasses import dataclass
from typing import Final, NamedTuple

from protocol.ring import SONARS


@dataclass(frozen=True, slots=True, kw_only=True)
class Qos:
    """The quality of service of a topic or service.

    `is_latched`: the newest `depth` samples reach late joiners (transient local). `lifespan_s` 0
    means that samples never expire.
    """

    depth: int = 10
    is_reliable: bool = True
    is_latched: bool = False
    lifespan_s: int = 0


RELIABLE: Final = Qos()
SENSOR_DATA: Final = Qos(depth=5, is_reliable=False)
LATCHED: Final = Qos(depth=1, is_latched=True)
PARAMETERS: Final = Qos(depth=1000)
ROSOUT: Final = Qos(depth=1000, is_latched=True, lifespan_s=10)


class RosTopic(NamedTuple):
    """A topic; a name that does not begin with `/` is below the namespace of the robot."""

    name: str
    type_name: str
    qos: Qos = RELIABLE

    def below(self, namespace: str) -> "RosTopic":
        """Return the topic with its absolute name."""
        is_absolute = self.name.startswith("/")
        return self if is_absolute else self._replace(name=f"{namespace}/{self.name}")


SONAR_FRAMES: Final = tuple(f"sonar_{number}" for number in range(SONARS))
"""Each sonar has a frame and a topic of this name, from right to left."""

SCAN: Final = "scan"
"""The topic that is an option."""

TOPICS: Final = (
    RosTopic("odom", "nav_msgs/msg/Odometry"),
    RosTopic("tf", "tf2_msgs/msg/TFMessage", Qos(depth=100)),
    RosTopic("tf_static", "tf2_msgs/msg/TFMessage", LATCHED),
    *(RosTopic(frame, "sensor_msgs/msg/Range", SENSOR_DATA) for frame in SONAR_FRAMES),
    RosTopic(SCAN, "sensor_msgs/msg/LaserScan", SENSOR_DATA),
    RosTopic("joint_states", "sensor_msgs/msg/JointState"),
    RosTopic("robot_description", "std_msgs/msg/String", LATCHED),
    RosTopic("plan", "nav_msgs/msg/Path"),
    RosTopic("markers", "visualization_msgs/msg/MarkerArray"),
    RosTopic("/clock", "rosgraph_msgs/msg/Clock", Qos(depth=1, is_reliable=False)),
    RosTopic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
    RosTopic("/rosout", "rcl_interfaces/msg/Log", ROSOUT),
)


NODE: Final = "sidestep"
"""The node that publishes them."""


def own_namespace(robot: str) -> str:
    """Return the namespace of a robot: its name, as far as ROS allows it."""
    return f"/{re.sub(r'[^A-Za-z0-9_]', '_', robot)}"


def topics(*, scan: bool) -> dict[str, RosTopic]:
    """Return the topics of a robot by their names in the table."""
    return {one.name: one for one in TOPICS if scan or one.name != SCAN}
