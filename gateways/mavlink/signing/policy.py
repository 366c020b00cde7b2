"""The rights of a client: by the signature of each frame, and the policy of its endpoint."""

from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Final

from gateways.mavlink.dialect import mavlink
from gateways.mavlink.signing.verifier import Verdict


class Policy(Enum):
    """The unsigned frames of an endpoint that may command."""

    REQUIRE = "require"
    """None of them."""
    LOOPBACK = "loopback"
    """Those from this machine."""
    ACCEPT = "accept"
    """All of them; refused for a TCP port that other machines reach."""
    ANYONE = "anyone"
    """All of them, also there."""


class Rights(Enum):
    """The rights of a frame."""

    NONE = 0
    STOP = 1
    """Nothing but an emergency stop."""
    WATCH = 2
    COMMAND = 3


WATCHING: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_PING,
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_ACK,
        mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
        mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST,
        mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM,
        mavlink.MAVLINK_MSG_ID_SET_MODE,
        mavlink.MAVLINK_MSG_ID_COMMAND_INT,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
        mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END,
        mavlink.MAVLINK_MSG_ID_SETUP_SIGNING,
    }
)
"""Messages that a client without the right to command may send. The protocols of commands, missions
and signing reject everything but reading; files are read-only."""

DOUBTS: Final = MappingProxyType(
    {
        Verdict.FUTURE: "is ahead of the gateway's clock",
        Verdict.REPLAYED: "is old, or was used before: a wrong clock, or a replay",
    }
)
"""What is wrong with the time stamp of a frame that is signed with a valid key. Such a frame can
only stop: a stop for nothing costs little, and one that is missing may cost a robot."""


@dataclass(slots=True)
class Counters:
    """Frames of one client, counted by the verdict on them."""

    signed: int = 0
    unsigned: int = 0
    forged: int = 0
    replayed: int = 0
    future: int = 0

    @property
    def refused(self) -> int:
        """Frames that command nothing because of their signature or its time stamp."""
        return self.forged + self.replayed + self.future


def rights_of(verdict: Verdict, policy: Policy, *, is_loopback: bool) -> Rights:
    """Return the rights of a frame."""
    if verdict is Verdict.VALID:
        return Rights.COMMAND
    if verdict in DOUBTS:
        return Rights.STOP
    if verdict is not Verdict.UNSIGNED:
        return Rights.NONE
    if policy in (Policy.ACCEPT, Policy.ANYONE) or (policy is Policy.LOOPBACK and is_loopback):
        return Rights.COMMAND
    return Rights.WATCH


def count(counters: Counters, verdict: Verdict) -> None:
    """Count a verdict."""
    match verdict:
        case Verdict.VALID:
            counters.signed += 1
        case Verdict.UNSIGNED:
            counters.unsigned += 1
        case Verdict.FORGED:
            counters.forged += 1
        case Verdict.REPLAYED:
            counters.replayed += 1
        case Verdict.FUTURE:
            counters.future += 1
