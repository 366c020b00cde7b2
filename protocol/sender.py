"""MAVLink system and component ids of each role."""

from typing import Final

from protocol.topics import Role

COMPONENT: Final = {Role.ROBOT: 1, Role.PLANT: 25, Role.GROUND: 190}
OPERATOR_SYSTEM: Final = 255
NO_ROLE: Final = (254, 0)
MAX_ROBOT_SYSTEM: Final = 250


def system_id_of(robot: str) -> int:
    """Return the number at the end of a robot's name, as in r7; 1 if there is none."""
    digits = robot[len(robot.rstrip("0123456789")) :]
    number = int(digits or 1)
    return number if 1 <= number <= MAX_ROBOT_SYSTEM else 1


def sender_of(role: Role | None, robot: str) -> tuple[int, int]:
    """Return system and component id of a sender; plant and robot are components of one system."""
    if role is None:
        return NO_ROLE
    return (OPERATOR_SYSTEM if role is Role.GROUND else system_id_of(robot)), COMPONENT[role]
