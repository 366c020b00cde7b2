"""Main loop of the plant process: publish sensor data, await answers, advance one period.

Between ticks it answers requests: start, pause, score.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from queue import SimpleQueue
from time import monotonic
from typing import Final

from plant.process.robot_link import RobotLink
from plant.sim.simulation import Plant
from protocol.bus.services import ServiceRequest
from protocol.wire.enums import AckResult, RunAction
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, RunRequest
from protocol.wire.reasons import Reason
from runtime.clock import Clock, WakeUp, ticks
from runtime.units import NS_PER_S, PERIOD_S
from runtime.watchdog import Patience

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


POLL_S: Final = 0.01
REPEAT_S: Final = 0.5
"""In lockstep, wall time after which a tick is published again: others see that the plant runs, and
a robot that has just joined receives the tick."""
PATIENCE_S: Final = 3.0
"""In lockstep, wall time after which simulated time advances without the answer of a robot that is
present; it counts less while the machine is busy. A supervisor restarts a robot that hangs."""


class Wake:
    """Wake the loop when a frame has arrived or the process must end."""

    def __init__(self) -> None:
        self._called = WakeUp()
        self.stopping = False

    def __call__(self, _: int = 0) -> None:
        """Wake the loop."""
        self._called.wake()

    def stop(self) -> None:
        """End the loop; may be called from a signal handler."""
        self.stopping = True
        self()

    def wait(self, timeout_s: float) -> bool:
        """Return True if something has arrived, False after the timeout."""
        return self._called.wait(timeout_s)


def nothing() -> None:
    """Do nothing."""


@dataclass(slots=True)
class Process:
    """The plant with its links to the robots and its request queue.

    `look` is called once per period, for observers. `turn` is called in each iteration of the loop,
    at least every `REPEAT_S`, also while simulated time is paused.
    """

    plant: Plant
    links: list[RobotLink]
    requests: RequestQueue
    wake: Wake
    patience_s: float = PATIENCE_S
    look: Callable[[], None] = nothing
    turn: Callable[[], None] = nothing
    _published_s: float = 0.0

    def publish(self) -> None:
        """Publish the data of this tick."""
        self._published_s = monotonic()
        for link in self.links:
            link.publish(self.plant)
        self.look()

    @property
    def silent(self) -> list[RobotLink]:
        """Robots that are expected to answer this tick and have not."""
        return [link for link in self.links if link.expected and not link.answered]

    def advance(self) -> None:
        """Apply the wheel commands and advance one period."""
        for link in self.links:
            link.apply_command(self.plant)
        self.plant.advance()

    def run_wall(self, clock: Clock) -> None:
        """Run one period of simulated time per period of wall time, paused or not."""
        for _ in ticks(clock, 1.0 / PERIOD_S):
            self._serve()
            if self.wake.stopping:
                return
            if self.requests.running:
                self.advance()
            self.publish()

    def run_lockstep(self, speed: float = inf) -> None:
        """Advance whenever every expected robot has answered, at most at `speed` x real time.

        Without one of the robots, time advances at most as fast as real time.
        """
        self._await_robots()
        pace_s = 0.0 if speed == inf else PERIOD_S / speed
        due_s = monotonic()
        while not self.wake.stopping:
            self.publish()
            self._await_answers()
            self._await_start()
            is_complete = all(link.expected for link in self.links)
            period_s = pace_s if is_complete else max(pace_s, PERIOD_S)
            due_s = max(due_s + period_s, monotonic() - period_s)
            self._await_due(due_s)
            self.advance()

    def _serve(self) -> None:
        self.turn()
        self.requests.serve(self.plant)

    def _await_due(self, due_s: float) -> None:
        while (remaining_s := due_s - monotonic()) > 0 and not self.wake.stopping:
            self.wake.wait(min(remaining_s, REPEAT_S))
            self._serve()

    def _await_robots(self) -> None:
        """Wait until all robots subscribe: data published before, such as tick 0, would be lost."""
        publishers = [publisher for link in self.links for publisher in link.publishers]
        while not (self.wake.stopping or all(publisher.matched for publisher in publishers)):
            self.wake.wait(POLL_S)
            self._serve()

    def _await_answers(self) -> None:
        """Wait for the expected robots; after `patience_s` expect the silent ones no more."""
        patience: Patience | None = None  # most answers come before it is needed
        while not self.wake.stopping:
            self._serve()
            silent = self.silent
            if not silent:
                return
            patience = patience or Patience(round(self.patience_s * NS_PER_S))
            remaining_s = patience.left_s()
            if remaining_s <= 0.0:
                for link in silent:
                    link.expect_no_more()
                return
            self._wait_or_repeat(remaining_s)

    def _await_start(self) -> None:
        while not (self.requests.running or self.wake.stopping):
            self._wait_or_repeat(REPEAT_S)
            self._serve()

    def _wait_or_repeat(self, timeout_s: float) -> None:
        """Wait for an arrival, and publish this tick again `REPEAT_S` after the last time."""
        remaining_s = self._published_s + REPEAT_S - monotonic()
        if remaining_s <= 0.0:
            self.publish()
        else:
            self.wake.wait(min(timeout_s, remaining_s))
