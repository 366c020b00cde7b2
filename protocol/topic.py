"""Definitions of a topic and a service, and the rules for names and keys."""

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
MAX_PERSON: Final = 23
"""With it an identity, of at most 32 more digits, fits into LEASE_STATUS."""

PERSON: Final = f"[A-Za-z0-9_-]{{1,{MAX_PERSON}}}"
PERSON_RULE: Final = f"use 1 to {MAX_PERSON} of the characters a-z, A-Z, 0-9, '_' and '-'"
OPERATOR: Final = re.compile(rf"{PERSON}/[0-9a-f]{{1,32}}\Z")
"""Identity of an operator on the bus: PERSON, which is the name in the certificate, and the id of
the process."""

RESERVED: Final = MappingProxyType(
    {
        "open": "it stands for every operator on an open bus",
        "ground": "it is the name of the holder of the certificate `ground`",
    }
    | dict.fromkeys(("router", "plant", "robot", "viewer"), "it is the name of a role")
    | dict.fromkeys(("recorder", "gateway"), "it is the name of a role")
)
"""Names that no operator can have, with the reason."""

PREFIX: Final = "sidestep"
ENCODING_FAMILY: Final = "application/mavlink2"
DIALECT: Final = "sidestep@2"
"""The version increases when an existing message changes, not when a message is added."""

ENCODING: Final = f"{ENCODING_FAMILY};{DIALECT}"

M_co = TypeVar("M_co", bound=Message, covariant=True)


class Role(Enum):
    """Role of a process on the bus."""

    PLANT = "plant"
    DRIVER = "driver"
    """The driver of a real robot's sensors and motors, in the place of a plant."""
    ROBOT = "robot"
    GROUND = "ground"


class Priority(Enum):
    """Priority of a sample on the bus; the numbers are those of Zenoh."""

    REAL_TIME = 1
    DATA_HIGH = 4
    DATA = 5
    DATA_LOW = 6


def operator_in(suffix: str) -> str:
    """Return the operator identity at the end of a key; empty if there is none."""
    return suffix if OPERATOR.match(suffix) else ""


def robot_name(name: str) -> str:
    """Return the name; raise UserError unless it is valid as one element of a key."""
    if not ROBOT_NAME.match(name):
        raise UserError(f"robot name {name!r}: {NAME_RULE}, as in 'r1'")
    return name


def robot_names(option: str, text: str) -> list[str]:
    """Return the names in the value of an option, as in r1,r2; UserError for bad or equal ones."""
    names = [robot_name(name) for name in text.split(",")]
    if len(set(names)) < len(names):
        raise UserError(f"{option} {text}: each robot needs a name of its own")
    return names


def operator_called(name: str) -> str:
    """Return the name; raise UserError unless an operator's certificate may contain it."""
    if not ROBOT_NAME.match(name):
        raise UserError(f"operator {name!r}: {NAME_RULE}, as in 'ada'")
    if name in RESERVED:
        raise UserError(f"operator {name!r}: {RESERVED[name]}: choose another name")
    return name


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic(Generic[M_co]):
    """A stream of samples. `rate_hz` 0: an event; `stale_after_ns` 0: never stale.

    `history` is the number of newest samples that the publisher retains for late joiners and for
    subscribers that were cut off. Only events have a history: a stream's next sample replaces the
    one before.
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
        """Return whether operators publish it, so that its keys end in an operator identity."""
        return self.publisher is Role.GROUND

    def key(self, robot: str, prefix: str = PREFIX) -> str:
        """Return the key of this topic for a robot."""
        return f"{prefix}/{robot_name(robot)}/{self.path}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Service:
    """A query that is always answered: one request frame or none, one reply."""

    path: str
    requests: tuple[type[Message], ...]
    server: Role
    priority: Priority = Priority.DATA
    expires: bool = True
    """Whether requests of operators carry a deadline."""

    doc: str

    @property
    def of_operators(self) -> bool:
        """Return whether its keys end in the identity of the requesting operator."""
        return self.server is Role.ROBOT

    def key(self, robot: str, prefix: str = PREFIX) -> str:
        """Return the key of this service for a robot."""
        return f"{prefix}/{robot_name(robot)}/{self.path}"


def person_of(operator: str) -> str:
    """Return the person to whom the program with this identity belongs; empty for none."""
    return operator.partition("/")[0]
