"""The driver of a real robot drives the simulated one: its pins are those of a plant."""

import re
from math import inf
from pathlib import Path
from typing import Any, cast

import pytest

from checks.harness.messages import make
from examples import hardware_driver
from examples.hardware_driver import ORDER, PING_MS, STALE_MS, TURN_RAD_S, Driver, Pins, check
from plant.model.configuration import noise_of
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.bus import Bus
from protocol.ring import SONARS
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import WheelCommand
from robot.core.modes import goal_is_active
from robot.core.parameters import DEFAULTS
from robot.core.states import REACHED
from robot.hosting import InProcessCore
from runtime.cli.parsers import parser_of
from runtime.cli.verb_table import find
from runtime.clock import ManualClock, WallClock
from runtime.config import start_totals
from runtime.errors import UserError
from runtime.units import NS_PER_MS as MS
from runtime.units import PERIOD_MS, PERIOD_NS
from study.trial.core_loop import CoreLoop
from study.trial.trial import start_of, wire_goal_of
from tests.support.each import each
from tests.support.pages import File, steps_of
from tests.support.played_bus import PlayedBus


class PlantPins(Pins):
    """The wiring of the simulated robot."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.wheels, self.scan = plant.senses()
        self.speeds: list[tuple[float, float]] = []

    def advance(self) -> None:
        self.plant.advance()
        self.wheels, self.scan = self.plant.senses()

    def ping(self, sonar: int) -> float | None:
        assert self.scan is not None
        if not self.scan.valid >> sonar & 1:
            return None
        return self.scan.range_mm[sonar] / 1000.0 if self.scan.echo >> sonar & 1 else inf

    def ticks(self) -> tuple[int, int]:
        assert self.wheels is not None
        return self.wheels.left, self.wheels.right

    def bumper(self) -> int:
        return 0 if self.wheels is None else self.wheels.bumper

    def drive(self, left_rad_s: float, right_rad_s: float) -> None:
        self.speeds.append((left_rad_s, right_rad_s))
        left, right = round(1000.0 * left_rad_s), round(1000.0 * right_rad_s)
        self.plant.command(0, left, right, MAX_WHEEL_TTL_MS)


@each("name", ["box", "u_trap", "corridor"])
def test_robot_arrives_with_sonars_that_ping_in_turn(name: str) -> None:
    world = load(name)
    plant = Plant(world, 0, noise_of(world, None))
    clock, pins = ManualClock(), PlantPins(plant)
    driver = Driver(pins, clock)
    params = DEFAULTS._replace(sonar_stale_ms=STALE_MS)
    onboard = CoreLoop(InProcessCore(params, start_of(world), start_totals(world.robot)))
    turn = iter(ORDER * 100_000)
    machine = onboard.state.machine
    for tick in range(20 * 300):
        for _ in range(PERIOD_MS // PING_MS):
            driver.ping(next(turn))
            clock.advance(PING_MS * MS)
        wheels, scan = driver.sense()
        outputs = onboard.step(clock.now_ns(), wheels, scan)
        if tick == SONARS:
            assert onboard.go(wire_goal_of(world)) == 0
        elif tick > SONARS and not goal_is_active(machine):
            break
        command = make(
            WheelCommand, seq=tick, sense_seq=wheels.seq, ttl_ms=MAX_WHEEL_TTL_MS,
            left_mrad_s=outputs.left_mrad_s, right_mrad_s=outputs.right_mrad_s,
        )  # fmt: skip
        assert driver.gate.receive(command) == ""
        driver.act()
        pins.advance()
    assert machine.goal_state == REACHED
    assert plant.score(plant.now_ns).contacts == 0


def test_a_ring_that_pings_in_turn_needs_its_own_stale_limit() -> None:
    assert sorted(ORDER) == list(range(SONARS))
    for before, sonar in zip(ORDER, ORDER[1:] + ORDER[:1], strict=True):
        assert abs(before - sonar) >= 3
    assert STALE_MS == 250
    assert DEFAULTS.sonar_stale_ms < STALE_MS


class StillPins(Pins):
    """Pins of a robot on a stand; `gains`: ticks of both encoders for a radian of each wheel."""

    def __init__(self, clock: ManualClock, gains: tuple[tuple[float, float], ...]) -> None:
        self._clock, self._gains = clock, gains
        self._since_ns = 0
        self._counts, self.speeds = [0.0, 0.0], [(0.0, 0.0)]

    def ping(self, sonar: int) -> float | None:
        return (None, inf, 0.5)[min(sonar, 2)]

    def ticks(self) -> tuple[int, int]:
        return round(self._counts[0]), round(self._counts[1])

    def drive(self, left_rad_s: float, right_rad_s: float) -> None:
        now_ns = self._clock.now_ns()
        for wheel, speed in enumerate(self.speeds[-1]):
            for encoder in (0, 1):
                turned_rad = speed * (now_ns - self._since_ns) / 1e9
                self._counts[encoder] += self._gains[wheel][encoder] * turned_rad
        self._since_ns = now_ns
        self.speeds.append((left_rad_s, right_rad_s))


TICKS = DEFAULTS.wheel_radius_m / DEFAULTS.m_per_tick


@each(
    ("gains", "left"),
    [
        (((TICKS, 0.0), (0.0, TICKS)), "495 ticks, ok"),
        (((-TICKS, 0.0), (0.0, TICKS)), "-495 ticks, WRONG: swap the phases"),
        (((0.0, TICKS), (TICKS, 0.0)), "0 ticks, WRONG: the other encoder"),
        (((0.5 * TICKS, 0.0), (0.0, TICKS)), "248 ticks, WRONG: 495 by wheel_radius_m"),
        (((0.0, 0.0), (0.0, TICKS)), "0 ticks, WRONG: swap the phases"),
    ],
)
def test_check_finds_swapped_and_silent_wires(gains: Any, left: str) -> None:
    clock = ManualClock()
    pins = StillPins(clock, gains)
    lines = list(check(pins, DEFAULTS, clock))
    assert lines[0].startswith(f"left wheel: {left}")
    assert pins.speeds[1:] == [(TURN_RAD_S, 0.0), (0.0, 0.0), (0.0, TURN_RAD_S), (0.0, 0.0)]
    assert lines[2] == "sonar 0 at -79 deg: WRONG: no answer"
    assert lines[3:5] == ["sonar 1 at -56 deg: inf m", "sonar 2 at -34 deg: 0.50 m"]


def driver_with(pins: Pins, clock: ManualClock) -> Driver:
    """Return a driver that executes a move of 150 ms which answers its first tick."""
    driver = Driver(pins, clock)
    driver.sense()
    move = make(WheelCommand, seq=0, sense_seq=0, ttl_ms=150, left_mrad_s=500, right_mrad_s=500)
    assert driver.gate.receive(move) == ""
    driver.act()
    return driver


def test_driver_brakes_at_the_end_of_the_last_command() -> None:
    clock = ManualClock()
    pins = StillPins(clock, ((TICKS, 0.0), (0.0, TICKS)))
    driver = driver_with(pins, clock)
    clock.advance(149 * MS)
    driver.act()
    assert pins.speeds[-1] == (0.5, 0.5)
    clock.advance(1 * MS)
    driver.act()
    assert pins.speeds[-1] == (0.0, 0.0)
    assert driver.sense()[0].expired == 1
    driver.act()
    assert len(pins.speeds) == 3, "it brakes once"


class BrokenPins(StillPins):
    """Pins whose encoders fail after a while, when a sonar has measured."""

    pinged = False

    def ping(self, sonar: int) -> float | None:
        self.pinged = True
        return 1.0

    def ticks(self) -> tuple[int, int]:
        if self.pinged:
            raise OSError("no answer from the encoders")
        return 0, 0


def test_driver_brakes_when_it_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    claimed: list[list[str]] = []
    monkeypatch.setattr(hardware_driver, "claim", lambda _bus, robots: claimed.append(robots))
    pins = BrokenPins(ManualClock(), ((0.0, 0.0), (0.0, 0.0)))
    bus = PlayedBus(ManualClock())
    with pytest.raises(OSError, match="no answer from the encoders"):
        hardware_driver.run(pins, cast("Bus", bus), "r1", WallClock())
    assert claimed == [["r1"]]
    assert pins.speeds[-1] == (0.0, 0.0)


def test_scan_has_only_what_was_measured_since_the_last() -> None:
    clock = ManualClock(PERIOD_NS)
    driver = Driver(StillPins(clock, ((0.0, 0.0), (0.0, 0.0))), clock)
    for sonar in (0, 1, 2):
        driver.ping(sonar)
        clock.advance(20 * MS)
    _, scan = driver.sense()
    assert (scan.valid, scan.echo) == (0b110, 0b100), "sonar 0 is broken, and 1 has no echo"
    assert (scan.range_mm[2], scan.ping_age_us[1:3]) == (500, (40_000, 20_000))
    assert driver.sense()[1].valid == 0


def test_driver_refuses_a_robot_that_forgets_too_early(tmp_path: Path) -> None:
    file = tmp_path / "stack.toml"
    file.write_text("[parameters]\nsonar_stale_ms = 150\n")
    with pytest.raises(UserError, match="write sonar_stale_ms = 250 below"):
        hardware_driver.main(Pins(), ["--config", str(file)])


PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "real-robot.md"


def test_units_of_the_guide_start_what_there_is() -> None:
    units = {one.name: one.text for one in steps_of(PAGE) if isinstance(one, File)}
    settings = units.pop("stack.toml")
    assert f"sonar_stale_ms = {STALE_MS}" in settings
    robot, driver = (
        re.findall(r"^ExecStart=\S+/(\w+) (.+)$", text, re.MULTILINE)[0] for text in units.values()
    )
    call = find(robot[1].split())
    assert robot[0] == "sidestep"
    assert call is not None
    assert parser_of(call.word).parse_args(call.arguments).realtime
    assert driver[1].endswith("my_driver.py --config /etc/sidestep/stack.toml")
    assert "ambient" in units["sidestep-robot.service"].lower(), "for --realtime"
