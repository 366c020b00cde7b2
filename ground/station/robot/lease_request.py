"""One question and its yes or no, off the thread of whoever shows it."""

from typing import Final

from ground.station.bus_protocols import Hears
from ground.station.robot.background_requests import Outcome
from protocol.topics import LEASE_SERVICE
from protocol.wire.enums import AckResult, LeaseAction
from protocol.wire.messages import CommandAck, LeaseRequest
from protocol.wire.reasons import reason_text
from runtime.clock import Clock
from runtime.errors import NoAnswer, RemoteError
from runtime.units import NS_PER_MS, NS_PER_S

ATTEMPTS: Final = 3
PATIENCE_S: Final = 0.4
DONE: Final = {
    LeaseAction.TAKE: "taken",
    LeaseAction.RELEASE: "released",
    LeaseAction.SEIZE: "SEIZED",
}


def ask_lease(
    bus: Hears, clock: Clock, robot: str, request: LeaseRequest, attempts: int = ATTEMPTS
) -> Outcome:
    """Take, release or seize; the same request again when there is no answer."""
    asked_ns = clock.now_ns()
    why = "no answer"
    for attempt in range(1, attempts + 1):
        try:
            answer = bus.ask(LEASE_SERVICE, request, PATIENCE_S, robot=robot)
        except NoAnswer as error:
            why = str(error)
            if attempt < attempts:
                clock.sleep_until(asked_ns + round(attempt * PATIENCE_S * NS_PER_S))
            continue
        if not isinstance(answer, CommandAck):
            raise RemoteError(f"{robot} answers, but not to a question about its lease")
        took = f"{(clock.now_ns() - asked_ns) / NS_PER_MS:.0f} ms"
        if answer.result == AckResult.ACCEPTED:
            return Outcome(True, f"lease of {robot} {DONE[LeaseAction(request.action)]} ({took})")
        return Outcome(False, f"lease of {robot} refused: {reason_text(answer.result_param2)}")
    return Outcome(False, f"lease of {robot}: {why}")
