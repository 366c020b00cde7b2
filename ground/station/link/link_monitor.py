"""Watches over the way to one robot: what is lost, and what has to be read after a loss."""

from typing import Any, Final

from ground.station.link.contact import Change, Contact, Need
from ground.station.link.loss import Loss, LossInputs, LossKind, judge
from ground.station.link.loss_texts import Known, does, ended, what
from ground.station.reader import Failed, Found, Parameters, Probe, Reader
from ground.station.robot.lease_state import Lease
from ground.station.robot.mission_items import Items
from ground.station.robot.robot_model import RobotModel, Tell
from ground.station.world import WorldFacts
from protocol.bus.network import Hub
from protocol.topics import (
    CLOCK,
    HEARTBEAT,
    INPUTS,
    LEASE,
    SONAR,
    STATUS,
    TRUTH,
    WHEELS,
    Role,
    Topic,
)
from protocol.wire.enums import Severity

INFO: Final = Severity.INFO
SENSES: Final = 3
"""TICK_INPUTS: 1 wheel ticks were there, 2 a scan was there."""
PLANT: Final[tuple[Topic[Any], ...]] = (SONAR, WHEELS, TRUTH, CLOCK)


class LinkMonitor:
    """Judged at each poll; what begins and what ends is told."""

    def __init__(self, watched: RobotModel, reader: Reader, now_ns: int, tell: Tell) -> None:
        self.contact = Contact(now_ns)
        self.world: WorldFacts | None = None
        self.round_trip_ns: int | None = None
        self._watched = watched
        self._reader = reader
        self._tell = tell
        self._hub: Hub | None = None
        self._linked_by: Hub | None = None
        self._kept_out = ""
        self._hub_seen_ns: int | None = None
        self._lease = Lease()
        self._was_ready = False

    def poll(self, now_ns: int, again: set[Role], lease: Lease) -> None:
        self._lease = lease
        for found in self._reader.poll(now_ns):
            self._found(found, now_ns)
        if Role.ROBOT in again:
            self.reread(now_ns)
        if Role.PLANT in again or (self.world is None and self._watched.tokens.get(Role.PLANT)):
            self._reader.want_once("world")
        signs = self._signs(now_ns)
        self._reader.hurry(signs.gone_ns is not None or self._silent(signs))
        kind = judge(signs)
        change = self.contact.judged(kind, now_ns, self._since_ns(kind, now_ns))
        if change is not None:
            self._changed(change, now_ns)
        self._see_ready(now_ns)

    def loss(self) -> Loss | None:
        kind = self.contact.kind
        if kind is None:
            return None
        known = self._known()
        return Loss(
            kind, self._watched.robot, what(kind, known), does(kind, known), self.contact.since_ns
        )

    def reread(self, now_ns: int) -> None:
        """Everything again, as after a loss."""
        self.contact.again(now_ns)
        self._watched.parameters.lose()
        self._want()
        self._was_ready = False

    def _want(self) -> None:
        for item in ("parameters", "mission", "fence"):
            self._reader.want(item)

    @property
    def waiting_for(self) -> str:
        return ", ".join(need.value for need in self.contact.missing)

    # What was read.

    def _found(self, found: Found, now_ns: int) -> None:
        match found:
            case Probe():
                self._hub, self._hub_seen_ns = found.hub, now_ns
                self._kept_out = found.kept_out
                self.round_trip_ns = found.round_trip_ns
                if found.hub.linked:
                    self._linked_by = found.hub
            case Parameters():
                self._read_parameters(found)
            case Items():
                self._watched.charts.take(found)
                self._reader.drop(found.kind.name.lower())
            case WorldFacts():
                self.world = found
                self._watched.figures.radius_m = found.radius_m
                self._reader.drop("world")
            case Failed("parameters", why):
                self._watched.parameters.failed(why)

    def _read_parameters(self, found: Parameters) -> None:
        """They are shown while the robot is heard, and count for `ready` once nothing is lost."""
        if not self.contact.heard or found.asked_ns < self.contact.back_ns:
            return
        self._watched.parameters.read(found.rows)
        self.contact.read(Need.PARAMETERS, found.asked_ns)
        self._reader.drop("parameters")

    def _see_ready(self, now_ns: int) -> None:
        for need, topic in ((Need.STATE, STATUS), (Need.LEASE, LEASE)):
            newest = self._watched.telemetry.latest(topic)
            if newest is not None:
                self.contact.read(need, newest[1])
        if self.contact.ready and not self._was_ready:
            words = self._watched.parameters.words(0)
            robot = self._watched.robot
            self._tell("ground", f"{robot}: state, lease and {words} parameters read: ready", INFO)
        self._was_ready = self.contact.ready

    # What is lost.

    def _changed(self, change: Change, now_ns: int) -> None:
        loss = self.loss()
        if loss is not None:
            worst = Severity.WARNING if loss.kind is LossKind.OTHER_OPERATOR else Severity.ERROR
            if not self.contact.heard:
                self._watched.parameters.lose()
                self._reader.drop("parameters")
            self._tell("ground", loss.banner(now_ns), worst)
        elif change.before is not None:
            self._tell("ground", ended(self._watched.robot, change.before, change.gap_ns), INFO)
            self._want()

    def _known(self) -> Known:
        newest = self._watched.telemetry.latest(STATUS)
        return Known(
            robot=self._watched.robot,
            hub=self._hub,
            kept_out=self._kept_out,
            linked_by_robot=self._linked_by is not Hub.ROUTER,
            plant_there=bool(self._watched.tokens.get(Role.PLANT)),
            status=None if newest is None else newest[0],
            lease=self._lease,
        )

    def _signs(self, now_ns: int) -> LossInputs:
        watched, telemetry = self._watched, self._watched.telemetry
        inputs = telemetry.fresh(INPUTS, now_ns)
        there = bool(watched.tokens.get(Role.ROBOT))
        others = [age for topic in PLANT if (age := self._age_ns(topic, now_ns)) is not None]
        senses = [self._age_ns(topic, now_ns) for topic in (SONAR, WHEELS)]
        return LossInputs(
            watched_ns=now_ns - watched.began_ns,
            hub=self._hub,
            hub_ns=None if self._hub_seen_ns is None else now_ns - self._hub_seen_ns,
            by_router=self._linked_by is Hub.ROUTER,
            kept_out=bool(self._kept_out),
            gone_ns=None if there else now_ns - watched.gone_ns,
            beat_ns=self._age_ns(HEARTBEAT, now_ns),
            loop_ns=self._age_ns(STATUS, now_ns),
            others_ns=min(others, default=None),
            senses_ns=None if None in senses else max(age for age in senses if age is not None),
            senses_missing=inputs is not None and inputs.flags & SENSES != SENSES,
            other_operator=self._lease.others,
        )

    def _age_ns(self, topic: Topic[Any], now_ns: int) -> int | None:
        newest = self._watched.telemetry.latest(topic)
        return None if newest is None else now_ns - newest[1]

    def _silent(self, signs: LossInputs) -> bool:
        return signs.alive_ns > HEARTBEAT.stale_after_ns

    def _since_ns(self, kind: LossKind | None, now_ns: int) -> int:
        """When what is lost was last there."""
        if kind is LossKind.OTHER_OPERATOR:
            return now_ns
        blind = kind is LossKind.SENSES_STALE
        topics: tuple[Topic[Any], ...] = (SONAR, WHEELS) if blind else (HEARTBEAT, STATUS)
        heard = [self._watched.telemetry.latest(topic) for topic in topics]
        arrived_ns = [newest[1] for newest in heard if newest is not None]
        return (min if blind else max)(arrived_ns, default=self._watched.began_ns)
