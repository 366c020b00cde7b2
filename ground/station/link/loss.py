"""What is lost, told apart: six kinds, each with what happened and what the robot does now."""

from enum import Enum
from typing import Final, NamedTuple

from protocol.bus.network import Hub
from protocol.topics import HEARTBEAT
from protocol.wire.limits import SCAN_LOST_MS
from runtime.units import NS_PER_MS, NS_PER_S

DEAD_NS: Final = 400 * NS_PER_MS
"""Two beats missed."""
CUT_NS: Final = 1_500 * NS_PER_MS
"""So long after a cable is cut the transport has noticed: its lease is 1 s."""
SENSES_NS: Final = SCAN_LOST_MS * NS_PER_MS
BEHIND_NS: Final = 200 * NS_PER_MS


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
        seconds = (now_ns - self.since_ns) / NS_PER_S
        return f"{self.kind.value} {self.robot} {seconds:.1f} s: {self.words}"


class LossInputs(NamedTuple):
    """All that a loss is judged by; ages in ns, None: never."""

    watched_ns: int
    """How long it has been listened for: the age of what was never heard."""
    hub: Hub | None = None
    hub_ns: int | None = None
    """How long ago the hub was looked at."""
    by_router: bool = False
    """A router was what linked us last."""
    kept_out: bool = False
    """Who takes our call does not let us in."""
    gone_ns: int | None = None
    """How long ago the robot's token went; None: it is there."""
    beat_ns: int | None = None
    loop_ns: int | None = None
    """The newest status, which comes more often than a beat."""
    others_ns: int | None = None
    """The newest frame of anybody but the robot and operators."""
    senses_ns: int | None = None
    """The older one of scan and wheels."""
    senses_missing: bool = False
    """The robot says itself that it has none."""
    other_operator: bool = False

    def age_ns(self, age_ns: int | None) -> int:
        return self.watched_ns if age_ns is None else age_ns

    @property
    def alive_ns(self) -> int:
        """The newest sign of life of the robot's loop: what it says is as good as a beat."""
        return min(self.age_ns(self.beat_ns), self.age_ns(self.loop_ns))

    @property
    def heard_ns(self) -> int:
        """The newest frame of anybody."""
        return min(self.alive_ns, self.age_ns(self.others_ns))

    @property
    def blind(self) -> bool:
        """The loop is heard, its senses are not; what stops at once with it is no sign of that."""
        senses_ns = self.age_ns(self.senses_ns)
        behind_ns = senses_ns - self.age_ns(self.loop_ns)
        return self.senses_missing or (senses_ns > SENSES_NS and behind_ns > BEHIND_NS)

    def linked_since(self, ago_ns: int) -> bool:
        """Was the link found to stand, later than so long ago?"""
        return self.hub_ns is not None and self.hub_ns < ago_ns


def judge(signs: LossInputs) -> LossKind | None:
    """The first that applies; None: everything is there, or it cannot be told yet what is not."""
    if signs.hub is not None and not signs.hub.linked and not _heard_since(signs):
        return _unlinked(signs, signs.hub)
    beat_ns = signs.alive_ns
    if signs.gone_ns is not None and beat_ns > DEAD_NS:
        known = _others(signs) or signs.linked_since(signs.gone_ns)
        return LossKind.PROCESS_DEAD if known else None
    if beat_ns > HEARTBEAT.stale_after_ns:
        known = _others(signs) or signs.linked_since(signs.heard_ns - CUT_NS)
        return LossKind.HUNG if known else None
    if signs.blind:
        return LossKind.SENSES_STALE
    return LossKind.OTHER_OPERATOR if signs.other_operator else None


def _heard_since(signs: LossInputs) -> bool:
    """A frame has come since the hub was looked at: whatever it was then, it links us now."""
    return signs.hub_ns is not None and signs.heard_ns < signs.hub_ns


def _others(signs: LossInputs) -> bool:
    """Somebody else is heard, also since the robot fell silent: it is not the link."""
    if signs.others_ns is None or signs.others_ns > HEARTBEAT.stale_after_ns:
        return False
    return signs.alive_ns - signs.others_ns > BEHIND_NS


def _unlinked(signs: LossInputs, hub: Hub) -> LossKind:
    if hub is Hub.UNREACHABLE or signs.kept_out:
        return LossKind.TRANSPORT
    if signs.by_router:
        return LossKind.ROUTER_GONE
    return LossKind.HUNG if hub is Hub.HANGS else LossKind.PROCESS_DEAD
