"""Where requests to the plant are answered: start, pause, score, and what the world is like."""

import json
from collections.abc import Callable
from queue import Empty, SimpleQueue

from plant.plant import Plant
from protocol.bus import Asked
from protocol.enums import AckResult, RunAction
from protocol.message import Message
from protocol.messages import CommandAck, RunRequest
from protocol.reasons import Reason


class Desk:
    """Requests are queued by the bus's threads and answered by the plant's own, between ticks."""

    def __init__(self, *, running: bool, world: object, nudge: Callable[[], None]) -> None:
        """`nudge` is called from the bus when there is something to answer."""
        self.running = running
        self._nudge = nudge
        self._world = json.dumps(world).encode()
        self._requests: SimpleQueue[tuple[int, Asked]] = SimpleQueue()

    def ask(self, robot: int, asked: Asked) -> None:
        """Called from the bus; returns at once."""
        self._requests.put((robot, asked))
        self._nudge()

    def serve(self, plant: Plant) -> None:
        while True:
            try:
                robot, asked = self._requests.get_nowait()
            except Empty:
                return
            request = asked.message
            asked.reply(
                self.answer(plant, robot, request)
                if isinstance(request, RunRequest)
                else self._world
            )

    def answer(self, plant: Plant, robot: int, request: RunRequest) -> Message:
        """START lets a paused plant go on; on a running one it begins a new score."""
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
    return CommandAck(command=0, result=result, result_param2=reason)
