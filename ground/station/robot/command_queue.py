"""Perform one command of the operator after the other; take the lease before one that moves."""

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

from ground.client.outcomes import Accepted, Refused
from ground.client.requests import ATTEMPTS, CommandExchange, RequestIds
from ground.client.vocabulary import HINTS
from ground.robot import Robot
from ground.station.robot.robot_session import RobotSession
from protocol.topics import LEASE_SERVICE
from protocol.wire.enums import LeaseAction, Severity
from protocol.wire.limits import MAX_OPERATOR_NAME_BYTES
from protocol.wire.messages import LeaseRequest
from protocol.wire.reasons import reason_text
from runtime.clock import Clock
from runtime.errors import LocalError, RemoteError
from runtime.units import NS_PER_MS
from runtime.watchdog import slowdown_in

LOG = logging.getLogger(__name__)
AddNote = Callable[[str, Severity], None]
Begin: TypeAlias = Callable[[Coroutine[Any, Any, None]], object]
"""Begins a coroutine in the event loop."""

PATIENCE_NS: Final = 400 * NS_PER_MS
REPLAYED: Final = "a replay accepts no commands"
MAX_WAITING: Final = 4
"""Commands that wait for the pending one, such as those that are typed ahead."""
DONE: Final = {
    LeaseAction.TAKE: "taken",
    LeaseAction.RELEASE: "released",
    LeaseAction.SEIZE: "SEIZED",
}


class JobResult(NamedTuple):
    """Result of a request in one or more lines: `ok 14 ms`, or the robot's reason."""

    ok: bool
    text: str


class Ended(Protocol):
    """The end of a command."""

    @property
    def ok(self) -> bool:
        """True if it succeeded."""

    @property
    def text(self) -> str:
        """The end in one or more lines."""


class QueuedCommand(Protocol):
    """A command of `ground.commands`, or what a screen does with a robot."""

    async def perform(self, robot: Robot, /) -> Ended:
        """Carry it out."""
        ...


class Witness(Protocol):
    """Sees the state before a command and its outcome, such as for `undo`."""

    async def before(self, robot: Robot, /) -> None:
        """Look when its turn has come."""

    def after(self, robot: Robot, outcome: Any, /) -> None:
        """Note what it has done."""


@dataclass(slots=True, eq=False)
class Given:
    """A command or a change of the lease, until its end is known."""

    words: str
    session: RobotSession
    command: QueuedCommand | LeaseAction
    moves: bool = False
    witness: Witness | None = None
    is_sent: bool = False
    asks_lease: bool = False
    """The lease that it needs has been asked for."""
    is_dropped: bool = False


class CommandQueue:
    """The pending command and those that wait; `last` is the last one with its result.

    `hints` are the remedies of refusals by reason, such as the keys of the app. `session` returns
    that of the robot which is shown; None in a recording.
    """

    def __init__(
        self,
        clock: Clock,
        begin: Begin,
        note: AddNote,
        name: str,
        session: Callable[[], RobotSession | None],
    ) -> None:
        self.last = ""
        self.hints: Mapping[int, str] = HINTS
        self._clock = clock
        self._begin = begin
        self._note = note
        self._session_now = session
        self._name = name.encode()[:MAX_OPERATOR_NAME_BYTES].decode(errors="ignore")
        self._ids = RequestIds()
        self._pending: Given | None = None
        self._waiting: deque[Given] = deque()
        self._polled = asyncio.Event()

    @property
    def busy(self) -> str:
        """Words of the pending command; empty without one."""
        return "" if self._pending is None else self._pending.words

    def refusal(self, *, moves: bool = True) -> str:
        """Return why a command is rejected now; `moves`: it moves the robot. Empty if allowed."""
        session = self._session_now()
        if session is None:
            return REPLAYED
        return session.refusal() if moves else ""

    def submit(
        self,
        words: str,
        command: QueuedCommand | LeaseAction,
        *,
        moves: bool = True,
        witness: Witness | None = None,
    ) -> bool:
        """Perform a command, or change the lease, in turn; return False with a note if rejected.

        One is pending at a time, and a few can wait. One that `moves` the robot takes the lease
        first. The result is a line in the log.
        """
        session, pending = self._session_now(), self._pending
        moves = moves and not isinstance(command, LeaseAction)
        why = self.refusal(moves=moves)
        if why or session is None:
            self._note(f"refused: {words}: {why}", Severity.WARNING)
            return False
        given = Given(words, session, command, moves, witness)
        if pending is None:
            self._pending = given
            self._begin(self._carry_out(given))
        elif len(self._waiting) == MAX_WAITING:
            words = f"not sent: {words}: `{pending.words}` is under way"
            self._note(words, Severity.WARNING)
            return False
        else:
            self._waiting.append(given)
        return True

    def lease(self, action: LeaseAction) -> None:
        """Acquire or release the lease in turn; a release then stops the heartbeat at once."""
        if self._session_now() is None:
            self._note(REPLAYED, Severity.WARNING)
        else:
            self.submit(f"lease {action.name.lower()}", action)

    def cancel(self, why: str) -> None:
        """Drop the commands that have not been sent yet; still wait for the pending answer."""
        pending = self._pending
        dropped = [given.words for given in self._waiting]
        self._waiting.clear()
        if pending is not None and pending.moves and not pending.is_sent:
            dropped.insert(0, pending.words)
            pending.is_dropped = True
            if pending.asks_lease:
                pending.words = "lease take"
            else:
                self._pending = None
        for words in dropped:
            self._note(f"not sent: {words}: {why}", Severity.WARNING)

    async def over(self) -> None:
        """Wait until no command is pending."""
        while self._pending is not None:
            await asyncio.sleep(0.01)

    def poll(self) -> None:
        """Let what waits for the lease look at it again."""
        self._polled.set()
        self._polled.clear()

    async def _carry_out(self, given: Given) -> None:
        """Perform a command and report its end; then begin the next one."""
        try:
            if isinstance(given.command, LeaseAction):
                await self._change_lease(given, given.command)
            elif not given.moves or await self._is_in_command(given):
                given.is_sent = True
                robot, witness = given.session.robot, given.witness
                if witness is not None:
                    await witness.before(robot)
                ended = await given.command.perform(robot)
                if witness is not None:
                    witness.after(robot, ended)
                refused = ended if isinstance(ended, Refused) else None
                text = refused.in_words(self.hints) if refused else ended.text
                self._end(given, ended.ok, text)
        except (RemoteError, LocalError) as error:
            self._end(given, False, str(error))
        except Exception as error:
            LOG.exception("a command has failed")
            self._end(given, False, f"internal error of the ground station: {error!r}")
        finally:
            if self._pending is given:
                following = self._waiting.popleft() if self._waiting else None
                self._pending = following
                if following is not None:
                    self._begin(self._carry_out(following))

    async def _is_in_command(self, given: Given) -> bool:
        """Take the lease if need be; return False, with the reason in the log, without it."""
        session, holding = given.session, given.session.holding
        if given.is_dropped:
            return False
        if why := session.refusal():
            self._note(f"refused: {given.words}: {why}", Severity.WARNING)
            return False
        if not holding.is_sure(self._clock.now_ns()):
            is_prolonged = holding.is_used
            given.asks_lease = True
            taken = await self._ask_lease(session, LeaseAction.TAKE)
            given.asks_lease = False
            if not (taken.ok or given.is_dropped):
                taken = JobResult(False, f"not sent: {given.words}: {taken.text}")
            if given.is_dropped or not (taken.ok and is_prolonged):
                self._report(taken)
            if given.is_dropped or not taken.ok:
                return False
        while holding.ours and not holding.settled(self._clock.now_ns()):
            await self._polled.wait()
            if given.is_dropped:
                return False
        if not holding.ours:
            lost = f"the lease of {session.robot.name} was lost meanwhile"
            self._note(f"not sent: {given.words}: {lost}", Severity.WARNING)
            return False
        holding.use(self._clock.now_ns())
        return True

    async def _change_lease(self, given: Given, action: LeaseAction) -> None:
        if action is LeaseAction.RELEASE:
            given.session.holding.release(self._clock.now_ns())
        self._report(await self._ask_lease(given.session, action), loud=action is LeaseAction.SEIZE)

    async def _ask_lease(self, session: RobotSession, action: LeaseAction) -> JobResult:
        """Take, release or seize the lease; repeat the same request without an answer."""
        robot = session.robot
        request = LeaseRequest(request_id=self._ids.next(), action=action, name=self._name)
        asking = CommandExchange(
            request,
            self._clock.now_ns(),
            attempts=round(ATTEMPTS * slowdown_in(self._clock)()),
            patience_ns=PATIENCE_NS,
        )
        answer = await robot.carry(asking, LEASE_SERVICE)
        if isinstance(answer, Refused):
            return JobResult(False, f"lease of {robot.name} refused: {reason_text(answer.reason)}")
        if not isinstance(answer, Accepted):
            why = "no answer" if answer is None else answer.why
            return JobResult(False, f"lease of {robot.name}: {why}")
        if action is not LeaseAction.RELEASE:
            session.holding.granted(self._clock.now_ns())
        took = f"{answer.took_ns / NS_PER_MS:.0f} ms"
        return JobResult(True, f"lease of {robot.name} {DONE[action]} ({took})")

    def _end(self, given: Given, ok: bool, text: str) -> None:
        self.last = f"{given.words}: {text}"
        several = "\n" in text.strip()
        self._report(JobResult(ok, text if several else self.last))

    def _report(self, result: JobResult, *, loud: bool = False) -> None:
        usual = Severity.WARNING if loud else Severity.INFO
        for line in result.text.splitlines():
            self._note(line, usual if result.ok else Severity.WARNING)
