"""The e-stop from the ground: asked until the robot says yes, or given up loudly."""

from collections.abc import Callable
from typing import Final

from ground.operator import Answered, Asking, GaveUp
from ground.station.hears import Hears
from ground.station.requests import Outcome
from protocol.clock import Clock
from protocol.enums import Command
from protocol.errors import RemoteError
from protocol.messages import CommandAck, CommandRequest
from protocol.topics import COMMAND

MS: Final = 1_000_000
NS_PER_S: Final = 1_000_000_000
PATIENCE_NS: Final = 250 * MS
GIVE_UP_NS: Final = 30 * NS_PER_S
ATTEMPTS: Final = GIVE_UP_NS // PATIENCE_NS
LOUD_NS: Final = NS_PER_S
"""How often it is said that there is no answer yet."""


class EmergencyStop:
    """One press. `run` belongs to the e-stop's thread, the rest to whoever shows it."""

    def __init__(self, request_id: int, robot: str, now_ns: int) -> None:
        self.robot = robot
        self.attempts = 0
        self.why = ""
        self._pressed_ns = self._told_ns = now_ns
        request = CommandRequest(
            request_id=request_id, param1=1.0, param2=0.0, command=Command.DO_FLIGHTTERMINATION
        )
        self._asking = Asking(request, now_ns, attempts=ATTEMPTS, patience_ns=PATIENCE_NS)

    def run(self, bus: Hears, clock: Clock, over: Callable[[], bool] = lambda: False) -> Outcome:
        """Ask until there is an answer, the time is up, or it is `over`."""
        asking = self._asking
        while asking.outcome is None and not over():
            for send in asking.due(clock.now_ns()):
                self.attempts += 1
                self._ask(bus, clock, send.request)
            if asking.outcome is None:
                clock.sleep_until(asking.next_ns)
        return self._told(asking.outcome)

    def _ask(self, bus: Hears, clock: Clock, request: object) -> None:
        assert isinstance(request, CommandRequest)
        try:
            answer = bus.ask(COMMAND, request, PATIENCE_NS / NS_PER_S, robot=self.robot)
        except RemoteError as error:
            self._failed(str(error))
            return
        if isinstance(answer, CommandAck):
            self._asking.receive(answer, clock.now_ns())
        else:
            self._failed("the answer is no acknowledgement")

    def _failed(self, why: str) -> None:
        self.why = why
        self._asking.unanswered(why)

    def _told(self, outcome: Answered | GaveUp | None) -> Outcome:
        tries = f"{self.attempts} {'try' if self.attempts == 1 else 'tries'}"
        if isinstance(outcome, Answered):
            took = f"{outcome.took_ns / MS:.0f} ms, {tries}"
            if outcome.ok:
                return Outcome(True, f"E-STOP acknowledged by {self.robot} after {took}")
            return Outcome(False, f"E-STOP REFUSED by {self.robot}: {outcome.text} ({took})")
        after = f"{GIVE_UP_NS // NS_PER_S} s" if outcome else "the station was closed"
        return Outcome(
            False,
            f"E-STOP GIVEN UP after {after}: {self.robot} has NOT acknowledged it ({tries}; "
            f"{self.why or 'no answer'})",
        )

    def words(self, now_ns: int) -> str:
        """How it stands while there is no answer."""
        seconds = (now_ns - self._pressed_ns) / NS_PER_S
        because = f": {self.why}" if self.why else ""
        return f"E-STOP of {self.robot} not acknowledged for {seconds:.1f} s, repeating{because}"

    def due(self, now_ns: int) -> str:
        """The same, once a second: to be said loudly."""
        if now_ns - self._told_ns < LOUD_NS:
            return ""
        self._told_ns = now_ns
        return self.words(now_ns)
