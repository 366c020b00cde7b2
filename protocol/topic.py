"""What a topic and a service are: how a key is made, who publishes, how long a sample counts."""

import re
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Final, Generic, TypeVar

from protocol.wire.message import Message
from runtime.errors import UserError

MAX_NAME: Final = 16
"""Characters of the name of a robot or an operator."""

NAME: Final = f"[a-z0-9_-]{{1,{MAX_NAME}}}"
NAME_RULE: Final = f"use 1 to {MAX_NAME} of the characters a-z, 0-9, '_' and '-'"
ROBOT_NAME: Final = re.compile(rf"{NAME}\Z")
OPERATOR: Final = re.compile(rf"{NAME}/[0-9a-f]{{1,32}}\Z")
"""Identity of an operator on the bus: the name in its certificate, and its session."""

RESERVED: Final = MappingProxyType(
    {
        "open": "every operator of an open bus is called so",
        "ground": "the holder of the certificate `ground` is called so",
        "router": "a role is called so",
        "plant": "a role is called so",
        "robot": "a role is called so",
        "viewer": "a role is called so",
        "recorder": "a role is called so",
    }
)
"""Names that no operator can have, and why."""

PREFIX: Final = "sidestep"
ENCODING_FAMILY: Final = "application/mavlink2"
DIALECT: Final = "sidestep@2"
"""The number counts up when a message that exists changes; a new one changes nothing for others."""

ENCODING: Final = f"{ENCODING_FAMILY};{DIALECT}"

M_co = TypeVar("M_co", bound=Message, covariant=True)


class Role(Enum):
    PLANT = "plant"
    ROBOT = "robot"
    GROUND = "ground"


class Priority(Enum):
    REAL_TIME = 1
    DATA_HIGH = 4
    DATA = 5
    DATA_LOW = 6


def operator_in(suffix: str) -> str:
    """Return the operator that the end of a key names; empty when it names none."""
    return suffix if OPERATOR.match(suffix) else ""


def robot_name(name: str) -> str:
    """The name itself; UserError unless it can be one element of a key."""
    if not ROBOT_NAME.match(name):
        raise UserError(f"robot name {name!r}: {NAME_RULE}, as in 'r1'")
    return name


def operator_called(name: str) -> str:
    """Return the name of an operator itself; raise UserError unless a certificate may name it."""
    if not ROBOT_NAME.match(name):
        raise UserError(f"operator {name!r}: {NAME_RULE}, as in 'ada'")
    if name in RESERVED:
        raise UserError(f"operator {name!r}: {RESERVED[name]}: choose another name")
    return name


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic(Generic[M_co]):
    """A pub/sub stream. `rate_hz` 0: an event; `stale_after_ns` 0: never stale.

    `history`: so many of the newest are kept by who sends them, for who comes later or was cut off.
    Only events have one: a stream's next frame says more than its last one.
    """

    path: str
    messages: tuple[type[M_co], ...]
    publisher: Role
    rate_hz: float
    stale_after_ns: int
    priority: Priority = Priority.DATA
    history: int = 0
    doc: str

    @property
    def of_operators(self) -> bool:
        """Return whether operators publish it: their keys end in the operator's identity."""
        return self.publisher is Role.GROUND

    def key(self, robot: str, prefix: str = PREFIX) -> str:
        return f"{prefix}/{robot_name(robot)}/{self.path}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Service:
    """A query that is always answered: one request frame (or none), one reply."""

    path: str
    requests: tuple[type[Message], ...]
    server: Role
    priority: Priority = Priority.DATA
    expires: bool = True
    """Requests of operators carry a deadline."""

    doc: str

    @property
    def of_operators(self) -> bool:
        """Return whether requests name their operator: their keys end in its identity."""
        return self.server is Role.ROBOT

    def key(self, robot: str, prefix: str = PREFIX) -> str:
        return f"{prefix}/{robot_name(robot)}/{self.path}"
