"""Monitor the link to one robot: a loss, its end, and what must be read before it is commanded."""

from enum import Enum
from typing import Any, Final, NamedTuple

from ground.station.link.loss import (
    Loss,
    LossInputs,
    LossKind,
    RobotKnowledge,
    cause_of,
    classify,
    end_of,
    response_of,
)
from ground.station.reader import Probe, Reader, ReadFailure, ReadParameters, ReadResult
from ground.station.robot.lease_state import LeaseView
from ground.station.robot.mission_items import DownloadedItems
from ground.station.robot.robot_model import AddLine, RobotModel
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
from runtime.units import NS_PER_MS, NS_PER_S

ONSET_NS: Final = 150 * NS_PER_MS
"""A loss is reported after its kind was the same for this time: streams do not stop at once."""
CHANGED_NS: Final = 1_500 * NS_PER_MS
"""A silent robot gets another kind of loss only after this time.

A returning robot is present in parts at first, and is dialled again within half a second.
"""
RECEIVING: Final = (None, LossKind.SENSES_STALE, LossKind.OTHER_OPERATOR)
"""With one of these kinds, data of the robot still arrive."""
SETTLED_NS: Final = 300 * NS_PER_MS
"""A loss is over when nothing was lost for this time: a single good frame does not end it."""


class Need(Enum):
    """Items to be read at the start and after each loss."""

    STATE = "state"
    PARAMETERS = "parameters"
    LEASE = "lease"


class ContactChange(NamedTuple):
    """A loss that has begun (`now`), or one that has ended (`before`), and its duration."""

    now: LossKind | None
    before: LossKind | None
    gap_ns: int


class Contact:
    """State of the contact, updated with a kind of loss at each poll."""

    def __init__(self, now_ns: int) -> None:
        self.kind: LossKind | None = None
        self.since_ns = now_ns
        self.back_ns = now_ns
        self._well_ns: int | None = None
        self._guess: LossKind | None = None
        self._guessed_ns = now_ns
        self._missing = set(Need)

    @property
    def ready(self) -> bool:
        """True if nothing is lost and everything was read since the last loss."""
        return self.kind is None and not self._missing

    @property
    def is_receiving(self) -> bool:
        """True if data of the robot's control loop arrive, even if it cannot be commanded."""
        return self.kind in RECEIVING

    @property
    def missing(self) -> tuple[Need, ...]:
        """Items not yet read since the last loss."""
        return tuple(need for need in Need if need in self._missing)

    def read(self, need: Need, arrived_ns: int) -> None:
        """Note that something was read; it counts only if it arrived after the loss."""
        if self.kind is None and arrived_ns >= self.back_ns:
            self._missing.discard(need)

    def require_all(self, now_ns: int) -> None:
        """Require that everything is read again, as after a loss."""
        self.back_ns = now_ns
        self._missing = set(Need)

    def update(self, kind: LossKind | None, now_ns: int, since_ns: int) -> ContactChange | None:
        """Update the kind of loss; return the change, if any.

        `since_ns` is the time of the last message of what is lost.
        """
        if kind is not self._guess:
            self._guess, self._guessed_ns = kind, now_ns
        if kind is None:
            return self._well(now_ns)
        self._well_ns = None
        sure_ns = ONSET_NS if self.is_receiving else CHANGED_NS
        if kind is self.kind or now_ns - self._guessed_ns < sure_ns:
            return None
        before = self.kind
        if before in RECEIVING or kind in RECEIVING:  # else the same silence under another name
            self.since_ns = since_ns
        self.kind = kind
        self._missing = set(Need)
        return ContactChange(kind, before, now_ns - self.since_ns)

    def _well(self, now_ns: int) -> ContactChange | None:
        if self.kind is None:
            return None
        if self._well_ns is None:
            self._well_ns = now_ns
        is_told = self.kind is LossKind.OTHER_OPERATOR  # the lease does not flicker like a link
        if now_ns - self._well_ns < SETTLED_NS and not is_told:
            return None
        before, self.kind = self.kind, None
        gap_ns = self._well_ns - self.since_ns
        self.require_all(self._well_ns)
        self._well_ns = None
        return ContactChange(None, before, gap_ns)


INFO: Final = Severity.INFO
SENSES: Final = 3
"""Bits of TICK_INPUTS: 1 for wheel ticks, 2 for a scan."""
PLANT: Final[tuple[Topic[Any], ...]] = (SONAR, WHEELS, TRUTH, CLOCK)

START_NS: Final = 20 * NS_PER_S
"""Longest time for which processes that are being started do not count as lost."""


class HubState:
    """State of this station's link to the hub, as last checked; all robots share it."""

    def __init__(self) -> None:
        self.hub: Hub | None = None
        self.linked_by: Hub | None = None
        """The hub that the last link was established with."""
        self.kept_out = ""
        self.checked_ns: int | None = None

    def take(self, found: Probe) -> None:
        """Store what a probe has found, if it has checked the hub."""
        if found.hub is None:
            return
        self.hub, self.checked_ns, self.kept_out = found.hub, found.checked_ns, found.kept_out
        if found.hub.linked:
            self.linked_by = found.hub


class LinkMonitor:
    """Checks the link at each poll; reports the start and the end of each loss.

    For a robot that is only watched, another operator is no loss.
    """

    def __init__(
        self,
        model: RobotModel,
        reader: Reader,
        now_ns: int,
        add_line: AddLine,
        hub_state: HubState,
    ) -> None:
        self.contact = Contact(now_ns)
        self.world: WorldFacts | None = None
        self.round_trip_ns: int | None = None
        self._model = model
        self._reader = reader
        self._add_line = add_line
        self._hub_state = hub_state
        self._lease = LeaseView()
        self._was_ready = False
        self._starting_until_ns = 0

    def poll(self, now_ns: int, restarted_roles: set[Role], lease: LeaseView) -> None:
        """Process what was read, classify the link and report changes."""
        self._lease = lease
        for found in self._reader.poll():
            self._process(found)
        if Role.ROBOT in restarted_roles:
            self.reread(now_ns)
        if Role.PLANT in restarted_roles or (
            self.world is None and self._model.tokens.get(Role.PLANT)
        ):
            self._reader.want_once("world")
        inputs = self._inputs(now_ns)
        self._reader.probe_often(inputs.gone_ns is not None or self._silent(inputs))
        kind = self._unless_starting(classify(inputs), now_ns)
        change = self.contact.update(kind, now_ns, self._since_ns(kind, now_ns))
        if change is not None:
            self._changed(change, now_ns)
        self._report_ready(now_ns)

    def loss(self) -> Loss | None:
        """Return the present loss, or None."""
        kind = self.contact.kind
        if kind is None:
            return None
        known = self._known()
        return Loss(
            kind,
            self._model.robot,
            cause_of(kind, known),
            response_of(kind, known),
            self.contact.since_ns,
        )

    def expect_start(self, now_ns: int) -> None:
        """Report no loss before the processes, which are being started, have been received."""
        self._starting_until_ns = now_ns + START_NS

    def _unless_starting(self, kind: LossKind | None, now_ns: int) -> LossKind | None:
        if now_ns >= self._starting_until_ns:
            return kind
        if kind is None and self._model.telemetry.latest(HEARTBEAT) is not None:
            self._starting_until_ns = 0
        return None

    def reread(self, now_ns: int) -> None:
        """Read everything again, as after a loss."""
        self.contact.require_all(now_ns)
        self._model.parameters.lose()
        self._want()
        self._was_ready = False

    def _want(self) -> None:
        for item in ("parameters", "mission", "fence"):
            self._reader.want(item)

    @property
    def waiting_for(self) -> str:
        """Items still to be read, in words."""
        return ", ".join(need.value for need in self.contact.missing)

    def _process(self, found: ReadResult) -> None:
        match found:
            case Probe():
                self._hub_state.take(found)
                self.round_trip_ns = found.round_trip_ns
            case ReadParameters():
                self._read_parameters(found)
            case DownloadedItems():
                self._model.mission_items.take(found)
                self._reader.drop(found.kind.name.lower())
            case WorldFacts():
                self.world = found
                self._model.plant_radius_m = found.radius_m
                self._reader.drop("world")
            case ReadFailure("parameters", why):
                self._model.parameters.failed(why)

    def _read_parameters(self, found: ReadParameters) -> None:
        """Show parameters while data arrive; count them for `ready` only without a loss."""
        if not self.contact.is_receiving or found.asked_ns < self.contact.back_ns:
            return
        self._model.parameters.read(found.rows)
        self.contact.read(Need.PARAMETERS, found.asked_ns)
        self._reader.drop("parameters")

    def _report_ready(self, now_ns: int) -> None:
        for need, topic in ((Need.STATE, STATUS), (Need.LEASE, LEASE)):
            newest = self._model.telemetry.latest(topic)
            if newest is not None:
                self.contact.read(need, newest[1])
        if self._reader.watches_only:
            return
        if self.contact.ready and not self._was_ready:
            words = self._model.parameters.words(0)
            robot = self._model.robot
            self._add_line(
                "ground", f"{robot}: state, lease and {words} parameters read: ready", INFO
            )
        self._was_ready = self.contact.ready

    def _changed(self, change: ContactChange, now_ns: int) -> None:
        loss = self.loss()
        if loss is not None:
            worst = Severity.WARNING if loss.kind is LossKind.OTHER_OPERATOR else Severity.ERROR
            if not self.contact.is_receiving:
                self._model.parameters.lose()
                self._reader.drop("parameters")
            self._add_line("ground", loss.banner(now_ns), worst)
        elif change.before is not None:
            ours = self._known().lease.ours
            ended = end_of(self._model.robot, change.before, change.gap_ns, ours=ours)
            if not (self._reader.watches_only and change.before is LossKind.OTHER_OPERATOR):
                self._add_line("ground", ended, INFO)
            self._want()

    def _known(self) -> RobotKnowledge:
        newest = self._model.telemetry.latest(STATUS)
        return RobotKnowledge(
            robot=self._model.robot,
            hub=self._hub_state.hub,
            kept_out=self._hub_state.kept_out,
            linked_by_robot=self._hub_state.linked_by is not Hub.ROUTER,
            plant_there=bool(self._model.tokens.get(Role.PLANT)),
            status=None if newest is None else newest[0],
            lease=self._lease,
            op_lost_ms=self._model.parameters.value("op_lost_ms"),
        )

    def _inputs(self, now_ns: int) -> LossInputs:
        model, telemetry, hub = self._model, self._model.telemetry, self._hub_state
        inputs = telemetry.fresh(INPUTS, now_ns)
        there = bool(model.tokens.get(Role.ROBOT))
        others = [age for topic in PLANT if (age := self._age_ns(topic, now_ns)) is not None]
        senses_ns = self._senses_ns(now_ns)
        return LossInputs(
            watched_ns=now_ns - model.began_ns,
            hub=hub.hub,
            hub_ns=None if hub.checked_ns is None else now_ns - hub.checked_ns,
            by_router=hub.linked_by is Hub.ROUTER,
            kept_out=bool(hub.kept_out),
            gone_ns=None if there else now_ns - model.gone_ns,
            heartbeat_ns=self._age_ns(HEARTBEAT, now_ns),
            status_ns=self._age_ns(STATUS, now_ns),
            others_ns=min(others, default=None),
            senses_ns=senses_ns,
            senses_missing=inputs is not None and inputs.flags & SENSES != SENSES,
            other_operator=self._lease.others and not self._reader.watches_only,
        )

    def _senses_ns(self, now_ns: int) -> int | None:
        """Return the age of the older one of scan and wheel ticks.

        A robot that is not followed tells with its status whether it has them.
        """
        if not self._model.telemetry.is_followed(SONAR):
            return self._age_ns(STATUS, now_ns)
        ages_ns = [self._age_ns(topic, now_ns) for topic in (SONAR, WHEELS)]
        known_ns = [age_ns for age_ns in ages_ns if age_ns is not None]
        return max(known_ns) if len(known_ns) == len(ages_ns) else None

    def _age_ns(self, topic: Topic[Any], now_ns: int) -> int | None:
        newest = self._model.telemetry.latest(topic)
        return None if newest is None else now_ns - newest[1]

    def _silent(self, inputs: LossInputs) -> bool:
        return inputs.alive_ns > HEARTBEAT.stale_after_ns

    def _since_ns(self, kind: LossKind | None, now_ns: int) -> int:
        """Return the time of the last message of what is lost."""
        if kind is LossKind.OTHER_OPERATOR:
            return now_ns
        senses_are_stale = kind is LossKind.SENSES_STALE
        topics: tuple[Topic[Any], ...] = (
            (SONAR, WHEELS) if senses_are_stale else (HEARTBEAT, STATUS)
        )
        newest_of_each = [self._model.telemetry.latest(topic) for topic in topics]
        arrived_ns = [newest[1] for newest in newest_of_each if newest is not None]
        return (min if senses_are_stale else max)(arrived_ns, default=self._model.began_ns)
