"""The messages and enumerations in use of MAVLink's common dialect.

Layouts and numbers are upstream's. The descriptions are our own: this repository contains no text
of upstream's files.
"""

from typing import Final

MESSAGES: Final = {
    "HEARTBEAT": "State of the sender, sent periodically from inside its control loop.",
    "SYSTEM_TIME": "Time of the sender's master clock.",
    "PARAM_REQUEST_READ": "Request one parameter, by name (index -1) or by index.",
    "PARAM_REQUEST_LIST": "Request all parameters.",
    "PARAM_VALUE": "Value of a parameter.",
    "PARAM_SET": "Set a parameter.",
    "MISSION_SET_CURRENT": "Select the current item.",
    "MISSION_CURRENT": "Index of the current item.",
    "MISSION_REQUEST_LIST": "Request the mission.",
    "MISSION_COUNT": "Number of items of a mission; starts a transfer.",
    "MISSION_CLEAR_ALL": "Delete the mission.",
    "MISSION_ITEM_REACHED": "An item has been reached.",
    "MISSION_ACK": "Result and end of a mission transfer.",
    "MISSION_REQUEST_INT": "Request one item.",
    "MANUAL_CONTROL": "Joystick axes and buttons, axes -1000 to 1000.",
    "MISSION_ITEM_INT": "One mission item.",
    "COMMAND_INT": "Command with a position as integers.",
    "COMMAND_LONG": "Command with seven parameters.",
    "COMMAND_ACK": "Answer to a command; result_param2 is a Reason.",
    "TIMESYNC": "Request for the time (tc1 = 0), or the answer to it.",
    "STATUSTEXT": "Line of text for the operator.",
}
"""Messages in use, each with its description."""

OPTIONAL: Final = {
    "HEARTBEAT": ("mavlink_version",),
    "COMMAND_INT": ("current", "autocontinue", "param1", "param2", "param3", "param4"),
    "COMMAND_LONG": ("confirmation", *(f"param{number}" for number in range(1, 8))),
    "MISSION_ITEM_INT": ("current", "autocontinue"),
}
"""Fields with a default value in Python, besides `target_*` and extensions."""

ENUMS: Final[dict[str, tuple[str, ...]]] = {
    "MAV_MISSION_TYPE": ("MISSION", "FENCE"),
    "MAV_CMD": (
        "NAV_WAYPOINT",
        "NAV_RETURN_TO_LAUNCH",
        "DO_SET_MODE",
        "DO_FLIGHTTERMINATION",
        "DO_REPOSITION",
        "DO_PAUSE_CONTINUE",
        "DO_SET_MISSION_CURRENT",
        "PREFLIGHT_REBOOT_SHUTDOWN",
        "MISSION_START",
        "COMPONENT_ARM_DISARM",
        "NAV_FENCE_POLYGON_VERTEX_INCLUSION",
        "NAV_FENCE_CIRCLE_INCLUSION",
    ),
    "MAV_RESULT": (
        "ACCEPTED",
        "TEMPORARILY_REJECTED",
        "DENIED",
        "UNSUPPORTED",
        "FAILED",
        "IN_PROGRESS",
    ),
    "MAV_SEVERITY": (
        "EMERGENCY",
        "ALERT",
        "CRITICAL",
        "ERROR",
        "WARNING",
        "NOTICE",
        "INFO",
        "DEBUG",
    ),
    "MAV_STATE": (
        "UNINIT",
        "BOOT",
        "CALIBRATING",
        "STANDBY",
        "ACTIVE",
        "CRITICAL",
        "EMERGENCY",
        "POWEROFF",
        "FLIGHT_TERMINATION",
    ),
    "MAV_TYPE": ("GCS", "GROUND_ROVER"),
    "MAV_AUTOPILOT": ("GENERIC", "ARDUPILOTMEGA", "INVALID"),
    "MAV_MODE_FLAG": ("CUSTOM_MODE_ENABLED", "SAFETY_ARMED"),
    "MAV_FRAME": (
        "GLOBAL",
        "GLOBAL_RELATIVE_ALT",
        "LOCAL_ENU",
        "GLOBAL_INT",
        "GLOBAL_RELATIVE_ALT_INT",
        "GLOBAL_TERRAIN_ALT",
        "GLOBAL_TERRAIN_ALT_INT",
        "LOCAL_FLU",
    ),
    "MAV_PARAM_TYPE": ("INT32", "REAL32"),
}
"""Members in use of each enumeration."""
