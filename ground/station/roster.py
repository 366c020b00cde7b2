"""List all watched robots, those that need attention first."""

from collections.abc import Iterable
from enum import IntEnum
from math import isfinite
from typing import Final, NamedTuple

from ground.client.status_line import PLACE_UNKNOWN, doing, knows_place
from ground.client.telemetry import Age, AgedMessage
from ground.station.fleet import Fleet
from ground.station.link.loss import Loss, LossKind
from ground.station.robot.lease_state import UNKNOWN, LeaseView
from protocol.topics import LEASE, ODOMETRY, STATUS
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.messages import NavigatorStatus


class Attention(IntEnum):
    """Ranks of the roster, the most urgent first."""

    STOPPED = 0
    """In failsafe or emergency stop, or a stop is not acknowledged."""
    STUCK = 1
    LOST = 2
    """No live status, or a loss."""
    UNPLACED = 3
    """Its position is unknown, so it refuses goals in the world."""
    NONE = 4


LOST_WORDS: Final = {
    LossKind.ROUTER_GONE: "no router",
    LossKind.TRANSPORT: "link lost",
    LossKind.PROCESS_DEAD: "dead",
    LossKind.HUNG: "hung",
    LossKind.SENSES_STALE: "no sensor data",
}


class RosterEntry(NamedTuple):
    """One robot: its state in words, its status with age, its loss and its link.

    `stopping` describes a stop that is not acknowledged. `goal_distance_m` is None without a goal
    or a live status. `link_percent` is None unless it was asked for. `round_trip_ms` is measured
    each 5 s of robots that are not selected.
    """

    robot: str
    is_selected: bool
    attention: Attention
    words: str
    status: AgedMessage
    goal_distance_m: float | None = None
    loss: Loss | None = None
    stopping: str = ""
    link_percent: float | None = None
    round_trip_ms: float | None = None
    lease: LeaseView = UNKNOWN

    @property
    def needs_attention(self) -> bool:
        """True for a robot that stopped itself, is stuck or lost, or has an unknown position."""
        return self.attention is not Attention.NONE


def roster_of(
    fleet: Fleet, selected: str, now_ns: int, *, links: bool = False
) -> list[RosterEntry]:
    """Return an entry for each watched robot, the most urgent first, then by name.

    With `links`, the share of delivered frames is computed, too.
    """
    entries = [_entry(fleet, robot, robot == selected, now_ns) for robot in fleet.models]
    if links:
        entries = [
            entry._replace(link_percent=fleet.models[entry.robot].streams.percent(now_ns))
            for entry in entries
        ]
    return by_attention(entries)


def by_attention(entries: Iterable[RosterEntry]) -> list[RosterEntry]:
    """Sort by attention, then by name with numbers in their order."""
    return sorted(entries, key=lambda entry: (entry.attention, *name_key(entry.robot)))


def name_key(robot: str) -> tuple[str, int, str]:
    """Return a sort key by which r2 comes before r10."""
    stem = robot.rstrip("0123456789")
    number = robot[len(stem) :]
    return stem, int(number or "0"), robot


def _entry(fleet: Fleet, robot: str, is_selected: bool, now_ns: int) -> RosterEntry:
    model, session = fleet.models[robot], fleet.sessions.get(robot)
    status = model.telemetry.seen(STATUS, now_ns)
    loss = None if session is None else session.link_monitor.loss()
    stopping = "" if session is None else session.stop.words
    trip_ns = None if session is None else session.link_monitor.round_trip_ns
    lease_seen = model.telemetry.seen(LEASE, now_ns)
    odometry = model.telemetry.latest(ODOMETRY)
    placed = odometry is None or knows_place(odometry[0])
    lease_known = session is not None and lease_seen.age is not Age.GONE
    return RosterEntry(
        robot=robot,
        is_selected=is_selected,
        attention=attention_of(status, loss, stopping, placed=placed),
        words=words_of(status, loss, placed=placed),
        status=status,
        goal_distance_m=distance_m(status),
        loss=loss,
        stopping=stopping,
        round_trip_ms=None if trip_ns is None else trip_ns / 1e6,
        lease=session.holding.lease if session is not None and lease_known else UNKNOWN,
    )


def attention_of(
    status: AgedMessage, loss: Loss | None, stopping: str = "", *, placed: bool = True
) -> Attention:
    """Return the rank of a robot with this newest status.

    A robot that stopped itself and is then lost keeps its rank: it is still stopped.
    """
    message = status.message
    if stopping:
        return Attention.STOPPED
    if isinstance(message, NavigatorStatus):
        if message.vehicle in (Vehicle.FAILSAFE, Vehicle.EMERGENCY_STOP):
            return Attention.STOPPED
        if status.age is not Age.GONE and message.goal == GoalState.STUCK:
            return Attention.STUCK
    lost = loss is not None and loss.kind is not LossKind.OTHER_OPERATOR
    if lost or status.age is Age.GONE:
        return Attention.LOST
    return Attention.NONE if placed else Attention.UNPLACED


def words_of(status: AgedMessage, loss: Loss | None, *, placed: bool = True) -> str:
    """Return the state in words: the vehicle or goal state, and what is lost or unknown."""
    message = status.message
    lost = "" if loss is None else LOST_WORDS.get(loss.kind, "")
    if not isinstance(message, NavigatorStatus):
        return lost or "no data"
    if status.age is Age.GONE:
        return lost or "stale"
    unknown = "" if placed else PLACE_UNKNOWN.lower()
    return ", ".join(filter(None, (doing(message), lost or unknown)))


def distance_m(status: AgedMessage) -> float | None:
    """Return the distance to the goal of a live status; None without a goal under way."""
    message = status.message
    if not isinstance(message, NavigatorStatus) or status.age is Age.GONE:
        return None
    under_way = GoalState.ACCEPTED <= message.goal <= GoalState.ALIGNING
    return message.goal_distance_m if under_way and isfinite(message.goal_distance_m) else None
