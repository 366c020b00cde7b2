"""The plant as a process: publish the senses, let the robots answer, let one period go by."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from time import monotonic
from typing import Final

from plant.process.requests import RequestQueue
from plant.process.robot_link import RobotLink
from plant.sim.simulation import Plant
from runtime.arrivals import WakeUp
from runtime.clock import Clock, ticks
from runtime.timing import PERIOD_NS
from runtime.units import NS_PER_S

PERIOD_S: Final = PERIOD_NS / NS_PER_S
POLL_S: Final = 0.01
PATIENCE_S: Final = 1.0
"""In lockstep, wall time after which simulated time goes on although a robot has not answered."""


class Wake:
    """Wake the loop when a frame has arrived or the process is to end, however often."""

    def __init__(self) -> None:
        self._called = WakeUp()
        self.stopping = False

    def __call__(self, _: int = 0) -> None:
        self._called.wake()

    def stop(self) -> None:
        """End the loop; may be called from a signal handler."""
        self.stopping = True
        self()

    def wait(self, timeout_s: float) -> bool:
        """True when something has arrived, False when the time is up."""
        return self._called.wait(timeout_s)


def nothing() -> None:
    """Nobody looks."""


@dataclass(frozen=True, slots=True)
class Process:
    """The plant, its wires to each robot, the desk where requests are answered.

    `look` is called once per period: somebody may want to see how it stands. `turn` is called at
    each turn of the loop, which comes at least once a second, also while time stands still.
    """

    plant: Plant
    wires: list[RobotLink]
    desk: RequestQueue
    wake: Wake
    patience_s: float = PATIENCE_S
    look: Callable[[], None] = nothing
    turn: Callable[[], None] = nothing

    def publish(self) -> None:
        self.look()
        for wires in self.wires:
            wires.publish(self.plant)

    def answered(self) -> bool:
        return all(wires.answered for wires in self.wires)

    def advance(self) -> None:
        for wires in self.wires:
            wires.obey(self.plant)
        self.plant.advance()

    def run_wall(self, clock: Clock) -> None:
        """One period of simulated time per period of wall time, paused or not."""
        for _ in ticks(clock, 1.0 / PERIOD_S):
            self._serve()
            if self.wake.stopping:
                return
            if self.desk.running:
                self.advance()
            self.publish()

    def run_lockstep(self, speed: float = inf) -> None:
        """A period goes by when every robot has answered; `speed` x real time at the most."""
        self._await_robots()
        pace_s = 0.0 if speed == inf else PERIOD_S / speed
        due_s = monotonic()
        while not self.wake.stopping:
            self.publish()
            self._await(self.answered)
            self._await_start()
            due_s = max(due_s + pace_s, monotonic() - pace_s)
            self._await_due(due_s)
            self.advance()

    def _serve(self) -> None:
        self.turn()
        self.desk.serve(self.plant)

    def _await_due(self, due_s: float) -> None:
        while (remaining_s := due_s - monotonic()) > 0 and not self.wake.stopping:
            self.wake.wait(min(remaining_s, self.patience_s))
            self._serve()

    def _await_robots(self) -> None:
        """What is published before somebody listens is lost, and with it the first tick."""
        publishers = [publisher for wires in self.wires for publisher in wires.publishers]
        while not (self.wake.stopping or all(publisher.matched for publisher in publishers)):
            self.wake.wait(POLL_S)
            self._serve()

    def _await(self, condition: Callable[[], bool]) -> None:
        deadline_s = monotonic() + self.patience_s
        while not self.wake.stopping:
            self._serve()
            if condition():
                return
            if not self.wake.wait(deadline_s - monotonic()):
                return

    def _await_start(self) -> None:
        while not (self.desk.running or self.wake.stopping):
            self.wake.wait(self.patience_s)
            self._serve()
