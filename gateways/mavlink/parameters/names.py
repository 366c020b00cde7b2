"""The names of the robot's parameters for MAVLink: at most 16 bytes, upper case.

Ground stations look up descriptions by the names of ArduPilot's Rover, so none of these names is
one of them. Some ground stations change names to upper case before they send them.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

MAX_NAME_BYTES: Final = 16
MAVLINK_NAMES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "radius_m": "RADIUS_M",
        "track_m": "TRACK_M",
        "wheel_radius_m": "WHEEL_RADIUS_M",
        "wheel_ratio": "WHEEL_RATIO",
        "m_per_tick": "M_PER_TICK",
        "wheel_max_m_s": "WHEEL_MAX_M_S",
        "v_max_m_s": "V_MAX_M_S",
        "yaw_max_rad_s": "YAW_MAX_RAD_S",
        "accel_m_s2": "ACCEL_M_S2",
        "period_s": "PERIOD_S",
        "k_r_m": "K_R_M",
        "k_l_m": "K_L_M",
        "sonar_max_m": "SONAR_MAX_M",
        "sonar_stale_ms": "SONAR_STALE_MS",
        "freeze_m": "FREEZE_M",
        "freeze_rad": "FREEZE_RAD",
        "freeze_front_m": "FREEZE_FRONT_M",
        "navigator": "NAVIGATOR",
        "side": "SIDE",
        "d_obs_m": "D_OBS_M",
        "d_th_m": "D_TH_M",
        "follow_m": "FOLLOW_M",
        "k_rho": "K_RHO",
        "k_omega": "K_OMEGA",
        "pose_k_rho": "POSE_K_RHO",
        "pose_k_omega": "POSE_K_OMEGA",
        "pose_h": "POSE_H",
        "pose_from_m": "POSE_FROM_M",
        "align_k": "ALIGN_K",
        "align_min_rad_s": "ALIGN_MIN_RAD_S",
        "spin_room_m": "SPIN_ROOM_M",
        "goal_max_m": "GOAL_MAX_M",
        "guard_stop_m": "GUARD_STOP_M",
        "guard_time_s": "GUARD_TIME_S",
        "op_lost_ms": "OP_LOST_MS",
        "wheel_min_m_s": "WHEEL_MIN_M_S",
        "wheel_time_ms": "WHEEL_TIME_MS",
        "wheel_share": "WHEEL_SHARE",
        "stuck_ms": "STUCK_MS",
        "stuck_m": "STUCK_M",
        "stuck_rad": "STUCK_RAD",
        "progress_ms": "PROGRESS_MS",
        "progress_m": "PROGRESS_M",
    }
)


def mavlink_name(name: str) -> str:
    """Return the name for MAVLink; a parameter that is not listed keeps its name, in upper case.

    The result is empty if that would be too long: such a parameter cannot be shown.
    """
    listed = MAVLINK_NAMES.get(name) or name.upper()
    return listed if len(listed) <= MAX_NAME_BYTES else ""
