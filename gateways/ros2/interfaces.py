"""The types of ROS 2 that this gateway sends and reads, and their CDR, by the library rosbags.

rosbags has the common messages. The services and actions are defined here, in the notation of
their `.srv` and `.action` files; tests compare the hashes of these definitions with the table.
"""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, Final

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gateways.ros2.wire import Distro

NOTHING: Final = "uint8 structure_needs_at_least_one_member\n"
"""The only field of a message without fields."""

PARTS: Final = "---\n"
MAX_ITEMS: Final = 100_000
"""Longest sequence that is read."""

SERVICES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "std_srvs/srv/Trigger": "---\nbool success\nstring message\n",
        "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message\n",
        "rcl_interfaces/srv/DescribeParameters": (
            "string[] names\n---\nrcl_interfaces/ParameterDescriptor[] descriptors\n"
        ),
        "rcl_interfaces/srv/GetParameters": (
            "string[] names\n---\nrcl_interfaces/ParameterValue[] values\n"
        ),
        "rcl_interfaces/srv/GetParameterTypes": "string[] names\n---\nuint8[] types\n",
        "rcl_interfaces/srv/ListParameters": (
            "string[] prefixes\nuint64 depth\n---\nrcl_interfaces/ListParametersResult result\n"
        ),
        "rcl_interfaces/srv/SetParameters": (
            "rcl_interfaces/Parameter[] parameters\n"
            "---\nrcl_interfaces/SetParametersResult[] results\n"
        ),
        "rcl_interfaces/srv/SetParametersAtomically": (
            "rcl_interfaces/Parameter[] parameters\n"
            "---\nrcl_interfaces/SetParametersResult result\n"
        ),
        "lifecycle_msgs/srv/GetState": "---\nlifecycle_msgs/State current_state\n",
        "action_msgs/srv/CancelGoal": (
            "action_msgs/GoalInfo goal_info\n"
            "---\nint8 return_code\naction_msgs/GoalInfo[] goals_canceling\n"
        ),
    }
)
NAVIGATE_TO_POSE: Final = (
    "geometry_msgs/PoseStamped pose\nstring behavior_tree\n"
    "---\nuint16 error_code\nstring error_msg\n"
    "---\ngeometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\n"
    "float32 distance_remaining\n"
)
TRACKING: Final = "float32 position_tracking_error\nfloat32 heading_tracking_error\n"
WAYPOINTS_GOAL: Final = (
    "uint32 number_of_loops\nuint32 goal_index\ngeometry_msgs/PoseStamped[] poses\n---\n"
)
CURRENT_WAYPOINT: Final = "---\nuint32 current_waypoint\n"
MISSED_WAYPOINT: Final = "uint32 index\ngeometry_msgs/PoseStamped goal\nuint16 error_code\n"
WAYPOINT_STATUS: Final = (
    "uint8 waypoint_status\nuint32 waypoint_index\ngeometry_msgs/PoseStamped waypoint_pose\n"
    "uint16 error_code\nstring error_msg\n"
)


def actions_of(distro: Distro) -> Mapping[str, str]:
    """Return the actions of Nav2 that differ between distributions, as `.action` files."""
    is_old = distro is Distro.JAZZY
    missed = "nav2_msgs/MissedWaypoint" if is_old else "nav2_msgs/WaypointStatus"
    result = f"{missed}[] missed_waypoints\nuint16 error_code\nstring error_msg\n"
    tracking = TRACKING if distro is Distro.LYRICAL else ""
    return {
        "nav2_msgs/action/NavigateToPose": NAVIGATE_TO_POSE + tracking,
        "nav2_msgs/action/FollowWaypoints": WAYPOINTS_GOAL + result + CURRENT_WAYPOINT,
    }


def definitions(distro: Distro) -> Iterator[tuple[str, str]]:
    """Yield name and text of each message that rosbags lacks, those within others first."""
    yield "nav2_msgs/msg/MissedWaypoint", MISSED_WAYPOINT
    yield "nav2_msgs/msg/WaypointStatus", WAYPOINT_STATUS
    for name, text in SERVICES.items():
        request, response = text.split(PARTS)
        yield f"{name}_Request", request or NOTHING
        yield f"{name}_Response", response
    for name, text in actions_of(distro).items():
        goal, result, feedback = text.split(PARTS)
        id_line = "unique_identifier_msgs/UUID goal_id\n"
        yield f"{name}_Goal", goal
        yield f"{name}_Result", result
        yield f"{name}_Feedback", feedback
        yield f"{name}_FeedbackMessage", f"{id_line}{name}_Feedback feedback\n"
        yield f"{name}_SendGoal_Request", f"{id_line}{name}_Goal goal\n"
        yield f"{name}_SendGoal_Response", "bool accepted\nbuiltin_interfaces/Time stamp\n"
        yield f"{name}_GetResult_Request", id_line
        yield f"{name}_GetResult_Response", f"int8 status\n{name}_Result result\n"


class Interfaces:
    """The types of a distribution: their classes, and the bytes of their messages."""

    def __init__(self, distro: Distro) -> None:
        self.distro = distro
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._store.max_sequence_length = MAX_ITEMS
        for name, text in definitions(distro):
            (fields,) = get_types_from_msg(text, name).values()
            self._store.register({name: fields})

    def make(self, name: str, /, *values: object, **named: object) -> Any:
        """Return a new message of a type, such as `std_msgs/msg/String`."""
        kind: Any = self._store.types[name]
        return kind(*values, **named)

    def encode(self, name: str, message: object) -> bytes:
        """Return the bytes of a message, in little-endian CDR."""
        return bytes(self._store.serialize_cdr(message, name, little_endian=True))

    def decode(self, name: str, data: bytes) -> Any:
        """Return the message in the bytes; None if they are none.

        What arrives may be cut short, or anything, and the library then raises many exceptions.
        As in ROS itself, bytes may follow the message: rclpy reserves more than it then needs.
        """
        if data[:2] not in (b"\0\0", b"\0\1"):
            return None
        try:
            found = self._store.get_msgdef(name)
            read = found.deserialize_cdr_le if data[1] else found.deserialize_cdr_be
            return read(data[4:], 0, found.cls, self._store)[0]
        except Exception:
            return None

    def hash_in_words(self, name: str) -> str:
        """Return the hash of a definition, as the library computes it from the fields."""
        return self._store.hash_rihs01(name)
