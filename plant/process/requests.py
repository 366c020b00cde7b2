"""Requests to the plant: start, pause, score, and the description of the world."""

import json
from collections.abc import Callable
from queue import SimpleQueue
from typing import Final

from plant.sim.simulation import Plant
from protocol.bus.service import ServiceRequest
from protocol.wire.enums import AckResult, RunAction
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, RunRequest
from protocol.wire.reasons import Reason

MAX_WAITING: Final = 64
MAX_ANSWERED: Final = 6
"""Requests per iteration of the loop; the score of a run takes up to a millisecond."""


class RequestQueue:
    """Queue of requests, filled by the bus and answered by the plant's loop between ticks.

    The description of the world is constant, so requests for it do not reach the loop.
    """

    def __init__(self, *, running: bool, world: object, nudge: Callable[[], None]) -> None:
        """Create the queue; `nudge` is called by the bus when there is a request."""
        self.running = running
        self._nudge = nudge
        self._world = json.dumps(world).encode()
        self._requests: SimpleQueue[tuple[int, ServiceRequest, RunRequest]] = SimpleQueue()

    def ask(self, robot: int, asked: ServiceRequest) -> None:
        """Enqueue a request, or refuse it if the queue is full; called by the bus."""
        request = asked.message
        if not isinstance(request, RunRequest):
            asked.reply(self._world)
        elif self._requests.qsize() >= MAX_WAITING:
            asked.reply(
                acknowledge(AckResult.TEMPORARILY_REJECTED, Reason.TOO_MANY_REQUESTS),
            )
        else:
            self._requests.put((robot, asked, request))
            self._nudge()

    def serve(self, plant: Plant) -> None:
        """Answer the next few requests; further ones wait for the next iteration of the loop."""
        for _ in range(min(self._requests.qsize(), MAX_ANSWERED)):
            robot, asked, request = self._requests.get_nowait()
            asked.reply(self.answer(plant, robot, request))
        if not self._requests.empty():
            self._nudge()

    def answer(self, plant: Plant, robot: int, request: RunRequest) -> Message:
        """Execute a request and return the answer.

        START resumes a paused plant; on a running one it begins a new score.
        """
        if request.action == RunAction.SCORE:
            return plant.score(request.until_ns, robot)
        if request.action == RunAction.START:
            if self.running:
                plant.restart_score()
        elif request.action != RunAction.PAUSE:
            return acknowledge(AckResult.UNSUPPORTED, Reason.UNKNOWN_COMMAND)
        self.running = request.action == RunAction.START
        return acknowledge(AckResult.ACCEPTED, Reason.NONE)


def acknowledge(result: AckResult, reason: Reason) -> CommandAck:
    """Return a COMMAND_ACK."""
    return CommandAck(command=0, result=result, result_param2=reason)
