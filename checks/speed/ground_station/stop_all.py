"""Latency of the stop of all robots: from the key in the terminal to the last wheel that stands."""

import argparse
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from threading import Event, Lock
from typing import Final

from checks.harness.figures import Figure, Report
from checks.harness.motion import Seen, standing_from, stood_s
from checks.harness.terminal import Terminal
from checks.harness.until import until
from checks.speed.ground_station.fleet import DRAWN, PATIENCE_S, DrivingFleet, driving_fleet
from checks.speed.ground_station.stage import SIZES
from ground.client.connection import Common
from ground.client.link import Link
from ground.client.operations.all_robots import ClearAll
from ground.client.operations.session import Session
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import TRUTH, Role
from protocol.wire.codec import decode
from protocol.wire.messages import GroundTruth
from runtime.clock import WallClock
from runtime.units import NS_PER_S

KEY: Final = "S"
AT_MOST_MS: Final = 150.0
MIN_DRIVING_M_S: Final = 0.1
PERIOD_S: Final = 0.05
"""Keys are pressed at random phases of the control period."""
STANDS_S: Final = 10.0
DRIVES_S: Final = 60.0


class Wheels:
    """The true motion of each robot; `since` returns it from a key press on."""

    def __init__(self, bus: Bus, robots: tuple[str, ...]) -> None:
        self._lock = Lock()
        self._seen: dict[str, list[tuple[int, GroundTruth]]] = {robot: [] for robot in robots}
        for robot in robots:
            bus.stream(TRUTH, self._note, robot)

    def _note(self, key: str, frame: bytes, arrived_ns: int) -> None:
        message, robot = decode(frame).message, key.split("/")[-3]
        if isinstance(message, GroundTruth):
            with self._lock:
                self._seen[robot].append((arrived_ns, message))

    def forget(self) -> None:
        """Forget all motion so far."""
        with self._lock:
            for seen in self._seen.values():
                seen.clear()

    def all_drive(self) -> bool:
        """Return whether the newest sample of every robot shows it driving."""
        with self._lock:
            return all(
                seen and seen[-1][1].speed_m_s > MIN_DRIVING_M_S for seen in self._seen.values()
            )

    def since(self, pressed_ns: int) -> dict[str, list[Seen]]:
        """Return the motion of each robot from a moment on, with times since then."""
        with self._lock:
            return {
                robot: [
                    Seen((at - pressed_ns) / NS_PER_S, one) for at, one in seen if at > pressed_ns
                ]
                for robot, seen in self._seen.items()
            }

    def all_stand(self, pressed_ns: int) -> bool:
        """Return whether every robot has come to rest since a moment."""
        return all(standing_from(seen) is not None for seen in self.since(pressed_ns).values())


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--presses", type=int, default=200, help="of the key that stops all (200)")


def measure(options: argparse.Namespace) -> Report:
    """Press the key while all robots drive, and wait until each stands; release and repeat."""
    worst_ms: list[float] = []
    of_robot: dict[str, list[float]] = {}
    random = Random(1)
    with TemporaryDirectory() as folder, driving_fleet(options.robots, Path(folder)) as fleet:
        network = Network(mode="client", connect=(fleet.endpoint,), connect_timeout_s=PATIENCE_S)
        words = ("ground", "--id", "r1", "--connect", fleet.endpoint, "--quiet-bell")
        with (
            open_bus(network, Role.GROUND, "r1") as bus,
            Terminal(words, SIZES[0], {"XDG_STATE_HOME": folder}) as terminal,
        ):
            wheels = Wheels(bus, fleet.robots)
            session = Session(Link(bus, Common(network=network, robot="r1"), WallClock()))
            terminal.shown(DRAWN, PATIENCE_S)
            for _ in range(options.presses):
                took_ms = one_press(terminal, wheels, session, random)
                worst_ms.append(max(took_ms.values()))
                for robot, ms in took_ms.items():
                    of_robot.setdefault(robot, []).append(ms)
    return Report(
        benchmark="stop_all",
        figures=tuple(figures_of(worst_ms, of_robot)),
        notes=notes_of(fleet, options.presses),
    )


def one_press(
    terminal: Terminal, wheels: Wheels, session: Session, random: Random
) -> dict[str, float]:
    """Press the key, and return the time in ms until the wheels of each robot stood."""
    until(wheels.all_drive, "all robots driving", within_s=DRIVES_S)
    Event().wait(random.uniform(0.0, PERIOD_S))
    wheels.forget()
    pressed_ns = terminal.type(KEY)
    until(lambda: wheels.all_stand(pressed_ns), "all robots at rest", within_s=STANDS_S)
    took_ms = {
        robot: (stood_s(seen) or 0.0) * 1e3 for robot, seen in wheels.since(pressed_ns).items()
    }
    released = ClearAll().perform(session)
    if not released.ok:
        raise RuntimeError(released.text)
    return took_ms


def figures_of(worst_ms: list[float], of_robot: dict[str, list[float]]) -> list[Figure]:
    """Return the figures of the last wheel of each press, and of each robot."""
    last = "key to the last wheel standing"
    return [
        Figure(name=last, unit="ms", values=tuple(worst_ms)),
        Figure(name=f"{last}, worst", unit="ms", values=(max(worst_ms),), at_most=AT_MOST_MS),
        *(
            Figure(name=f"{robot}: key to wheels standing, worst", unit="ms", values=(max(ms),))
            for robot, ms in sorted(of_robot.items())
        ),
    ]


def notes_of(fleet: DrivingFleet, presses: int) -> tuple[str, ...]:
    """Return the notes below the figures: the setting, and how each press was timed."""
    return (
        f"{len(fleet.robots)} robots driving in wall time, {presses} presses of {KEY} in the app",
        "from the write of the key into the pty to the beginning of the first period without"
        " motion of the last robot, as the plant's truth shows it",
    )
