"""A whole stack that goes on by itself at 20 Hz, and a station that watches it for real."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import pytest

from ground.client.api import robot
from ground.client.connection import Common
from ground.client.vocabulary import Remedies
from ground.station.link.loss import LossKind
from ground.station.station import Station
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from runtime.clock import Tick, WallClock
from runtime.units import PERIOD_NS
from tests.support.harness import Stack
from tests.support.until import PATIENCE_S, until

PERIOD_S: Final = PERIOD_NS / 1e9
POLL_S: Final = 0.05


class Lively(Stack):
    """A stack without lockstep. `hung`: the robot's loop stops; `mute`: the plant stops."""

    period_s = PERIOD_S
    """Between two ticks, which are always 50 ms of simulated time apart."""

    def __init__(self, *, router: bool = False, parameters: dict[str, float] | None = None) -> None:
        super().__init__("open", router=router, parameters=parameters)
        self.hung = self.mute = False
        self._turning = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._go_on, daemon=True)

    @contextmanager
    def going(self) -> Iterator[None]:
        self._thread.start()
        try:
            yield
        finally:
            self._over.set()
            self._thread.join()

    @contextmanager
    def halted(self) -> Iterator[None]:
        """Pause the stack, so that processes can be stopped and started."""
        with self._turning:
            yield

    def start(self, name: str) -> None:
        """Start a process; a restarted plant advances to the time of the others."""
        super().start(name)
        while self.plant is not None and self.plant.plant.now_ns < self.clock.now_ns():
            self.plant.advance()

    def _go_on(self) -> None:
        while not self._over.wait(self.period_s):
            with self._turning:
                self._turn()

    def _turn(self) -> None:
        if self.plant is not None and not self.mute:
            self.plant.publish()
        if self.robot is not None and not self.hung:
            self.robot.cycle(Tick(self._ticks, self.clock.now_ns(), 0, 0))
        if self.plant is not None and not self.mute:
            self.plant.advance()
        self._ticks += 1
        self.clock.advance(PERIOD_NS)


class Paced(Lively):
    """A stack in which each process waits for the other, and misses its operator after a minute.

    So no failsafe of a busy machine ends what a program drives.
    """

    def __init__(self) -> None:
        super().__init__(parameters={"op_lost_ms": 60_000})

    def _turn(self) -> None:
        self.cycle()


class Watching:
    """A station with a link of its own, polled by the waiting test."""

    def __init__(self, station: Station) -> None:
        self.station = station

    def until(self, condition: Callable[[], object], within_s: float = PATIENCE_S) -> float:
        """Poll until it holds; how long that took."""

        def met() -> object:
            self.station.poll()
            return condition()

        return until(met, within_s, lambda: "\n".join(map(str, self.station.log)), POLL_S)

    def until_lost(self, kind: LossKind) -> float:
        return self.until(lambda: (loss := self.station.loss()) and loss.kind is kind)

    def until_ready(self) -> float:
        return self.until(lambda: self.station.ready)

    def kinds(self) -> list[str]:
        """Return the names of the losses reported so far.

        Without those for a moment that a busy machine adds, because plant and robot are threads of
        this process: a loss of sensor data, and of a link, beside another loss.
        """
        names = [kind.value for kind in LossKind]
        found = [
            name for line in self.station.log for name in names if line.text.startswith(f"{name} ")
        ]
        for late in (LossKind.SENSES_STALE.value, LossKind.TRANSPORT.value):
            if set(found) - {late}:
                found = [name for name in found if name != late]
        return list(dict.fromkeys(found))


@contextmanager
def watching(stack: Stack, endpoint: str | None = None, name: str = "anna") -> Iterator[Watching]:
    hub, prefix = endpoint or stack._hub, stack._prefix
    network = Network(mode="client", connect=(hub,), prefix=prefix, person=name)
    with open_bus(network, Role.GROUND, "r1") as bus:
        station = Station(bus, "r1", WallClock(), name=name)
        try:
            yield Watching(station)
        finally:
            station.close()


def dials(stack: Lively, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Options by which a program finds the stack; `config` is the person who uses it."""

    def common(
        endpoint: str | None, _: str | None, config: str | None, *, remedies: Remedies
    ) -> Common:
        assert endpoint is not None
        network = Network(
            mode="client", connect=(endpoint,), prefix=stack._prefix, person=config or ""
        )
        return Common(network=network, robot="r1", remedies=remedies)

    monkeypatch.setattr(robot, "common", common)
    return ["--connect", stack._hub]
