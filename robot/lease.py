"""The lease: which person may command the robot, and which of that person's programs are there.

Without a lease everybody may. Sans-I/O. `allows` and `is_holder` are thread-safe, because they read
one reference.
"""

from collections import OrderedDict
from typing import Final, NamedTuple, TypeVar

from protocol.bus.network import GATEWAY, without_digits
from protocol.topic import person_of
from protocol.wire.enums import LeaseAction, Severity
from protocol.wire.limits import MAX_LEASE_MS, MAX_OPERATOR_NAME_BYTES
from protocol.wire.messages import LeaseRequest, LeaseStatus
from robot.core import reasons
from runtime.cli.terminal import printable
from runtime.units import NS_PER_MS, NS_PER_S

LAPSE_NS: Final = 3_000 * NS_PER_MS
LAPSE_S: Final = LAPSE_NS / NS_PER_S
IDLE_NS: Final = MAX_LEASE_MS * NS_PER_MS
IDLE_S: Final = IDLE_NS / NS_PER_S
MAX_PROGRAMS: Final = 64
"""Programs whose heartbeats and names are kept: those with the newest ones."""

T = TypeVar("T")


class Asker(NamedTuple):
    """Who asks: the identity of a program on the bus, and the display name in its request.

    One gateway asks for many clients, each with a name of its own.
    """

    operator: str = ""
    name: str = ""

    @property
    def person(self) -> str:
        """The person that commands by this program; it is the person who has the lease."""
        return person_of(self.operator)

    @property
    def party(self) -> str:
        """The person, or the client of a gateway, whose clients are different persons."""
        return self.name if without_digits(self.person) == GATEWAY else self.person

    @property
    def label(self) -> str:
        """The display name, else the person; as much of it as fits into a message."""
        label = self.name or without_digits(self.person)
        return label.encode()[:MAX_OPERATOR_NAME_BYTES].decode(errors="ignore")


class Lease:
    """The lease, which a person takes, releases or seizes by any program.

    It ends LAPSE_NS after the last heartbeat of the person's programs, once one has sent one since
    the grant, and IDLE_NS after its last use. Both times pass on the robot's clock, and in
    `stood_ns` while that of a simulation stands, as it does without its plant.
    """

    def __init__(self) -> None:
        self._holder: Asker | None = None
        self._granted_ns = self._used_ns = 0
        self.stood_ns = 0
        self._beats_ns: OrderedDict[str, int] = OrderedDict()
        self._inherited = "", 0
        """The program that took over last, and the last heartbeat of the one before."""

        self._heard_ns: OrderedDict[str, int] = OrderedDict()
        self._left_ns: OrderedDict[str, int] = OrderedDict()
        self._names: OrderedDict[str, str] = OrderedDict()
        self._texts: list[tuple[Severity, str]] = []

    def allows(self, operator: str) -> bool:
        """Return whether this program may command the robot; thread-safe."""
        holder = self._holder
        return holder is None or holder.person == person_of(operator)

    def receive(self, request: LeaseRequest, operator: str, now_ns: int) -> int:
        """Act on a request and return a reason, 0 if granted; a repetition changes nothing."""
        if not operator:
            return reasons.NO_OPERATOR
        if request.action != LeaseAction.SEIZE and not self.allows(operator):
            return reasons.LEASE_HELD
        asker = Asker(operator, printable(request.name))
        if request.action == LeaseAction.RELEASE:
            if self._holder is None:
                return reasons.NO_LEASE
            self._release(asker)
        elif request.action == LeaseAction.LEAVE:
            self._leave(asker, now_ns)
        elif request.action in (LeaseAction.TAKE, LeaseAction.SEIZE):
            self._grant(asker, now_ns)
        else:
            return reasons.UNKNOWN_COMMAND
        return reasons.OK

    def beat(self, operator: str, sent_ns: int) -> None:
        """Note a heartbeat of a program that may command, sent at `sent_ns`.

        One that arrives after its program has left is ignored: the program is gone.
        """
        if sent_ns < self._left_ns.get(operator, sent_ns):
            return
        keep(self._beats_ns, operator, max(self._beats_ns.get(operator, sent_ns), sent_ns))
        heard_ns = sent_ns + self.stood_ns
        keep(self._heard_ns, operator, max(self._heard_ns.get(operator, heard_ns), heard_ns))

    def beaten_ns(self, operator: str) -> int | None:
        """Return when the newest heartbeat was sent that counts for this program, None without.

        That is its own, or until it sends one that of the program from which it took over. For an
        unnamed program those of all count that may command.
        """
        heir, inherited_ns = self._inherited
        times_ns = [ns for one, ns in self._beats_ns.items() if self._counts(one, operator)]
        if heir and self._counts(heir, operator):
            times_ns.append(inherited_ns)
        return max(times_ns, default=None)

    def own_beat_ns(self, operator: str) -> int | None:
        """Return when this program itself sent its newest heartbeat, None before the first."""
        return self._beats_ns.get(operator)

    def _counts(self, one: str, operator: str) -> bool:
        return one == operator if operator else self.allows(one)

    def inherit(self, operator: str, before: str) -> None:
        """Let the heartbeat of a program count for the one that takes over from it.

        It keeps the robot driving until the heir's own one arrives; the heir is not there by it.
        """
        if (time_ns := self.beaten_ns(before)) is not None:
            self._inherited = operator, time_ns
        if (time_ns := self._heard_ns.get(before)) is not None:
            keep(self._heard_ns, operator, max(self._heard_ns.get(operator, time_ns), time_ns))

    def use(self, now_ns: int) -> None:
        """Note that the person has the robot drive, or asks for what needs the lease."""
        self._used_ns = max(self._used_ns, now_ns + self.stood_ns)

    def due(self, now_ns: int) -> list[tuple[Severity, str]]:
        """End an expired lease, and pass one on from a program that is silent to one that is not.

        Return the texts for operators, each with its severity.
        """
        holder, now_ns = self._holder, now_ns + self.stood_ns
        if holder is not None and now_ns > self._idle_ns:
            words = f"lease of {holder.label} given back: nothing driven for {IDLE_S:g} s"
            self._end(Severity.INFO, words)
        elif holder is not None and now_ns > self._ends_ns:
            words = f"lease of {holder.label} lapsed: no heartbeat for {LAPSE_S:g} s"
            self._end(Severity.WARNING, words)
        elif holder is not None and now_ns > self._heard_of(holder.operator) + LAPSE_NS:
            self._pass_on(now_ns)
        texts, self._texts = self._texts, []
        return texts

    def is_holder(self, operator: str) -> bool:
        """Return whether this program's person holds the lease; thread-safe."""
        holder = self._holder
        return holder is not None and holder.person == person_of(operator)

    @property
    def holder(self) -> Asker | None:
        """The program that has taken the lease, or another one of its person; None without one."""
        return self._holder

    def status(self, time_ns: int, now_ns: int, drive_id: int, driver: str) -> LeaseStatus:
        """Return the lease as a message, stamped `time_ns`, with the newest drive and its name."""
        holder, now_ns = self._holder, now_ns + self.stood_ns
        return LeaseStatus(
            time_ns=time_ns,
            lapses_ms=0 if holder is None else max(0, self._ends_ns - now_ns) // NS_PER_MS,
            held=int(holder is not None),
            holder="" if holder is None else holder.operator,
            name="" if holder is None else holder.name,
            drive_id=drive_id,
            driver=driver,
        )

    @property
    def _newest_ns(self) -> int | None:
        """When a program that may command was last heard, None before the first."""
        return max((ns for one, ns in self._heard_ns.items() if self.allows(one)), default=None)

    def _heard_of(self, operator: str) -> int:
        """Return when the holder was last heard: by a heartbeat, or as it took the lease."""
        return max(self._heard_ns.get(operator, self._granted_ns), self._granted_ns)

    def _pass_on(self, now_ns: int) -> None:
        """Show the program of the holder's person that was heard last, if one sends heartbeats."""
        own = ((ns, one) for one, ns in self._heard_ns.items() if self.is_holder(one))
        heard_ns, operator = max(own, default=(0, ""))
        if operator and now_ns - heard_ns <= LAPSE_NS:
            self._holder = Asker(operator, self._names.get(operator, ""))

    @property
    def _idle_ns(self) -> int:
        """When the lease ends unless it is used."""
        return self._used_ns + IDLE_NS

    @property
    def _ends_ns(self) -> int:
        """When the lease ends unless it is used, or kept by heartbeats once there were some."""
        heard_ns = self._newest_ns
        if heard_ns is None or heard_ns <= self._granted_ns:
            return self._idle_ns
        return min(heard_ns + LAPSE_NS, self._idle_ns)

    def _grant(self, new: Asker, now_ns: int) -> None:
        old = self._holder
        if old is None:
            self._announce(Severity.INFO, f"{new.label} has taken the lease")
        elif old.person != new.person:
            self._announce(Severity.CRITICAL, f"LEASE SEIZED by {new.label} from {old.label}")
        keep(self._names, new.operator, new.name)
        self._holder = new
        self._granted_ns = now_ns + self.stood_ns
        self.use(now_ns)

    def _leave(self, asker: Asker, now_ns: int) -> None:
        """Release the lease, or pass it on to another program of the person that is there."""
        operator = asker.operator
        for known in (self._beats_ns, self._heard_ns, self._names):
            known.pop(operator, None)
        keep(self._left_ns, operator, now_ns)
        if self._inherited[0] == operator:
            self._inherited = "", 0
        heard_ns = self._newest_ns
        if heard_ns is None or now_ns + self.stood_ns - heard_ns > LAPSE_NS:
            self._release(asker)
        else:  # by the heartbeats of the other one, though they may be older than the grant
            self._granted_ns = 0
            if self._holder is not None and self._holder.operator == operator:
                self._pass_on(now_ns + self.stood_ns)

    def _release(self, asker: Asker) -> None:
        if self._holder is not None:
            self._end(Severity.INFO, f"{asker.label} has released the lease")

    def _end(self, severity: Severity, words: str) -> None:
        self._holder = None
        self._announce(severity, words)

    def _announce(self, severity: Severity, words: str) -> None:
        self._texts.append((severity, words))


def keep(newest: OrderedDict[str, T], operator: str, value: T) -> None:
    """Store a value of a program, and drop those of the longest unheard ones beyond the limit."""
    newest[operator] = value
    newest.move_to_end(operator)
    if len(newest) > MAX_PROGRAMS:
        newest.popitem(last=False)
