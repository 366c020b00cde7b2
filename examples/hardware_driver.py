"""Drive real motors and sensors in the place of the simulation: fill in `Pins` for your board.

    python examples/hardware_driver.py --config stack.toml --check  # wheels off the ground
    python examples/hardware_driver.py --config stack.toml

`--check` turns each wheel forward and compares its encoder, then measures with each sonar. The file
is that of the robot process.
"""

import argparse
import signal
import sys
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from math import degrees, isfinite
from typing import Final

from plant.robot_link import CommandGate
from protocol.bus.bus import Bus, claim, open_bus
from protocol.options import add_network_options, network_of
from protocol.ring import BEARINGS_RAD, SONARS
from protocol.topics import DRIVE, SONAR, WHEELS, Role
from protocol.wire.messages import SonarScan, WheelTicks
from robot.core.parameters import DEFAULTS, Params
from robot.parameter_table import adjusted
from robot.run import RobotSettings
from runtime.clock import Clock, WakeUp, WallClock, ticks
from runtime.config import load_shared
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_MS, NS_PER_S, PERIOD_MS, PERIOD_NS

ORDER: Final = tuple(3 * i % SONARS for i in range(SONARS))
"""Firing order: one sonar looks at least 67 degrees away from the one before, so that it does not
take its echo for an own one."""

PING_MS: Final = 25
"""From ping to ping: sound goes 4.2 m and back, beyond the range of the sonars."""

STALE_MS: Final = SONARS * PING_MS + PERIOD_MS
"""`sonar_stale_ms` for this order: so old is a range when the next one of that sonar arrives."""

TURN_RAD_S: Final = 3.0
TURN_S: Final = 1.0
"""Of a wheel in the check."""
SHARE: Final = 0.8
"""Of the expected ticks that are enough."""


class Pins:
    """The wiring of one robot, to be written: `ping` takes 20 ms at most, the others no time."""

    def ping(self, sonar: int) -> float | None:
        """Return a range from the rim in metres, inf without an echo, None for a broken sonar.

        Sonar 0 looks to the right, 7 to the left.
        """
        raise NotImplementedError("Pins.ping: read a sonar")

    def ticks(self) -> tuple[int, int]:
        """Return the counts of the left and the right encoder, which grow forward."""
        raise NotImplementedError("Pins.ticks: read the encoders")

    def bumper(self) -> int:
        """Return the pressed sectors: 1 left, 2 right, 4 rear; 0 also for a robot without any."""
        return 0

    def drive(self, left_rad_s: float, right_rad_s: float) -> None:
        """Set the speeds that the motor board holds under any load; 0 brakes."""
        raise NotImplementedError("Pins.drive: set the motors")


class Driver:
    """Make messages of what the pins measure, and wheel speeds of the commands that are admitted.

    `ping` may run in a thread of its own.
    """

    def __init__(self, pins: Pins, clock: Clock) -> None:
        self.gate = CommandGate()
        self._pins, self._clock = pins, clock
        self._pings: deque[tuple[int, int, float]] = deque(maxlen=SONARS)
        self._tick = -1
        self._ends_ns: int | None = None
        self._expired = False

    def ping(self, sonar: int) -> None:
        """Measure with one sonar, for the next scan."""
        at_ns, range_m = self._clock.now_ns(), self._pins.ping(sonar)
        if range_m is not None:
            self._pings.append((sonar, at_ns, range_m))

    def sense(self) -> tuple[WheelTicks, SonarScan]:
        """Begin a control period: return the counters, and the ranges since the last one."""
        now_ns, valid, echo = self._clock.now_ns(), 0, 0
        range_mm, age_us = [0] * SONARS, [0] * SONARS
        while self._pings:
            sonar, at_ns, range_m = self._pings.popleft()
            valid |= 1 << sonar
            age_us[sonar] = min((now_ns - at_ns) // 1000, 0xFFFF)
            if isfinite(range_m):
                echo |= 1 << sonar
                range_mm[sonar] = max(1, round(1000.0 * range_m))
        self._tick += 1
        self.gate.begin_tick(self._tick)
        (left, right), bumper = self._pins.ticks(), self._pins.bumper()
        wheels = WheelTicks(
            time_ns=now_ns, seq=self._tick, left=left, right=right, bumper=bumper,
            expired=int(self._expired),
        )  # fmt: skip
        scan = SonarScan(
            time_ns=now_ns, seq=self._tick, range_mm=tuple(range_mm), ping_age_us=tuple(age_us),
            valid=valid, echo=echo,
        )  # fmt: skip
        return wheels, scan

    def act(self) -> None:
        """Execute the newest admitted command, and brake when the last one has ended."""
        now_ns = self._clock.now_ns()
        if output := self.gate.take():
            self._ends_ns, self._expired = now_ns + output.ttl_ms * NS_PER_MS, False
            self._pins.drive(output.left_mrad_s / 1000.0, output.right_mrad_s / 1000.0)
        elif self._ends_ns is not None and now_ns >= self._ends_ns:
            self._ends_ns, self._expired = None, True
            self._pins.drive(0.0, 0.0)


def run(pins: Pins, bus: Bus, robot: str, clock: Clock) -> None:
    """Drive until an exception; brake at the end."""
    driver, arrived = Driver(pins, clock), WakeUp()
    wheels, sonar = bus.publisher(WHEELS, robot), bus.publisher(SONAR, robot)
    bus.mailbox(DRIVE, robot, lambda _at_ns: arrived.wake(), check=driver.gate.receive)
    claim(bus, [robot])

    def ping_in_turn() -> None:
        for tick in ticks(clock, 1000.0 / PING_MS):
            if stopped.is_set():
                return
            driver.ping(ORDER[tick.index % SONARS])

    pinging, stopped = threading.Thread(target=ping_in_turn, daemon=True), threading.Event()
    pinging.start()
    due_ns = clock.now_ns()
    try:
        while pinging.is_alive():
            counters, scan = driver.sense()
            wheels.put(counters)
            sonar.put(scan)
            due_ns = max(due_ns + PERIOD_NS, clock.now_ns())
            while (left_ns := due_ns - clock.now_ns()) > 0:
                arrived.wait(min(left_ns / NS_PER_S, 0.01))
                driver.act()
    finally:
        pins.drive(0.0, 0.0)
        stopped.set()


def check(pins: Pins, params: Params, clock: Clock) -> Iterator[str]:
    """Turn each wheel forward and measure with each sonar; yield what is found."""
    expected = TURN_RAD_S * TURN_S * params.wheel_radius_m / params.m_per_tick
    for wheel, name in enumerate(("left", "right")):
        before = pins.ticks()
        try:
            pins.drive(*(TURN_RAD_S if one == wheel else 0.0 for one in (0, 1)))
            clock.sleep_until(clock.now_ns() + round(TURN_S * NS_PER_S))
        finally:
            pins.drive(0.0, 0.0)
        counts = [after - start for start, after in zip(before, pins.ticks(), strict=True)]
        yield f"{name} wheel: {counts[wheel]} ticks, {verdict(counts, wheel, expected)}"
    for sonar in range(SONARS):
        range_m = pins.ping(sonar)
        found = "WRONG: no answer" if range_m is None else f"{range_m:.2f} m"
        yield f"sonar {sonar} at {degrees(BEARINGS_RAD[sonar]):+.0f} deg: {found}"


def verdict(counts: Sequence[int], wheel: int, expected: float) -> str:
    """Judge the ticks of both encoders after one wheel was turned forward."""
    own, other = counts[wheel], counts[1 - wheel]
    if abs(other) > abs(own):
        return "WRONG: the other encoder has counted, swap the two motors or the two encoders"
    if own <= 0:
        return "WRONG: swap the phases of its encoder, or its motor's wires if it turned backward"
    if not SHARE < own / expected < 1.0 / SHARE:
        return f"WRONG: {expected:.0f} by wheel_radius_m and m_per_tick, or it is too slow"
    return "ok"


def main(pins: Pins, argv: list[str] | None = None) -> int:
    """Check the wiring, or drive until stopped."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    add_network_options(parser)
    parser.add_argument("--check", action="store_true", help="turn each wheel, ping each sonar")
    given, clock = parser.parse_args(argv), WallClock()
    settings = load_shared(given.config, RobotSettings) if given.config else RobotSettings()
    params = adjusted(DEFAULTS, settings.parameters, str(given.config))
    if given.check:
        print(*check(pins, params, clock), sep="\n")
        return 0
    if given.config and params.sonar_stale_ms < STALE_MS:
        raise UserError(f"{given.config}: write sonar_stale_ms = {STALE_MS} below [parameters]")
    network = network_of(given, settings.network, listens=False)
    with open_bus(network, Role.DRIVER, settings.robot) as bus:
        run(pins, bus, settings.robot, clock)
    return 1


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # of systemd: brake, as on any exit
    try:
        sys.exit(main(Pins()))
    except KeyboardInterrupt:
        sys.exit(130)
    except (NotImplementedError, UserError, RemoteError) as error:
        sys.exit(f"hardware_driver: {error}")
