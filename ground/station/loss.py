"""What is lost, told apart: six kinds, each with what happened and what the robot does now."""

from enum import Enum
from typing import Final, NamedTuple

from protocol.topics import HEARTBEAT

MS: Final = 1_000_000
SILENT_NS: Final = 1_500 * MS
"""Nothing from anybody for so long: by then the transport has noticed if it was cut (lease 1 s)."""


class LossKind(Enum):
    """The order is that of rank: what is above explains what is below."""

    ROUTER_GONE = "ROUTER GONE"
    TRANSPORT = "LINK LOST"
    PROCESS_DEAD = "ROBOT DEAD"
    HUNG = "ROBOT HUNG"
    SENSES_STALE = "SENSES STALE"
    OTHER_OPERATOR = "OTHER OPERATOR"


class Loss(NamedTuple):
    """`what` has happened, what the robot `does` now by itself, and since when."""

    kind: LossKind
    robot: str
    what: str
    does: str
    since_ns: int

    @property
    def words(self) -> str:
        return f"{self.what}; {self.does}"

    def banner(self, now_ns: int) -> str:
        """The whole line: what is lost, for how long, why, and what the robot does now."""
        seconds = (now_ns - self.since_ns) / 1e9
        return f"{self.kind.value} {self.robot} {seconds:.1f} s: {self.words}"


class Hub(Enum):
    """What the bus says of its own connection."""

    LINKED = "linked"
    HANGS = "hangs"  # takes the call and says nothing
    ENDED = "ended"  # refuses the call
    UNREACHABLE = "unreachable"  # the call comes to nothing
    UNKNOWN = "unknown"


class Signs(NamedTuple):
    """All that a loss is judged by; ages in ns, None: never heard."""

    hub: Hub
    by_router: bool
    robot_there: bool
    plant_there: bool
    beat_ns: int | None
    heard_ns: int | None  # the newest frame of anybody
    watched_ns: int  # how long it has been listened for
    senses_ns: int | None  # the older of scan and wheels
    senses_missing: bool  # the robot says so itself
    other_operator: bool


def judge(signs: Signs) -> LossKind | None:
    """The first that applies; None: everything is there."""
    if signs.hub not in (Hub.LINKED, Hub.UNKNOWN):
        return _unlinked(signs)
    if not _beats(signs):
        return _silent(signs)
    if signs.senses_missing or _stale(signs.senses_ns):
        return LossKind.SENSES_STALE
    return LossKind.OTHER_OPERATOR if signs.other_operator else None


def _unlinked(signs: Signs) -> LossKind:
    if signs.hub is Hub.UNREACHABLE:
        return LossKind.TRANSPORT
    if signs.by_router:
        return LossKind.ROUTER_GONE
    return LossKind.HUNG if signs.hub is Hub.HANGS else LossKind.PROCESS_DEAD


def _beats(signs: Signs) -> bool:
    age_ns = signs.watched_ns if signs.beat_ns is None else signs.beat_ns
    return age_ns <= HEARTBEAT.stale_after_ns


def _silent(signs: Signs) -> LossKind | None:
    if not signs.robot_there:
        return LossKind.PROCESS_DEAD
    others_ns = signs.watched_ns if signs.heard_ns is None else signs.heard_ns
    beat_ns = signs.watched_ns if signs.beat_ns is None else signs.beat_ns
    hangs = others_ns < HEARTBEAT.stale_after_ns or beat_ns > SILENT_NS
    return LossKind.HUNG if hangs else None


def _stale(senses_ns: int | None) -> bool:
    return senses_ns is not None and senses_ns > SENSES_NS


SENSES_NS: Final = 250 * MS
