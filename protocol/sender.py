"""Who a frame is from: MAVLink system and component of each role."""

from typing import Final

from protocol.topics import Role

COMPONENT: Final = {Role.ROBOT: 1, Role.PLANT: 25, Role.GROUND: 190}
OPERATOR_SYSTEM: Final = 255
NOBODY: Final = (254, 0)
MAX_ROBOT_SYSTEM: Final = 250


def system_id_of(robot: str) -> int:
    """The number at the end of a robot's name, as in r7; 1 without one."""
    digits = robot[len(robot.rstrip("0123456789")) :]
    number = int(digits or 1)
    return number if 1 <= number <= MAX_ROBOT_SYSTEM else 1


def sender_of(role: Role | None, robot: str) -> tuple[int, int]:
    """System and component id; plant and robot are two components of one system."""
    if role is None:
        return NOBODY
    return (OPERATOR_SYSTEM if role is Role.GROUND else system_id_of(robot)), COMPONENT[role]
