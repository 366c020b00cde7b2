"""A ring of eight sonars: converts the nearest surfaces into readings in millimetres.

Even sonars ping half a period before the stamp of the scan, odd ones at the stamp.
"""

from typing import Final, NamedTuple

from plant.model.body import Body
from plant.model.noise import Noise
from plant.sim.active_faults import SonarFaults
from plant.sim.seeds import gaussian_rows, uniform_rows
from plant.sim.sensing.raycast import ORDER
from plant.sim.sensing.surfaces import SONARS

EARLY_US: Final = 25_000
PING_AGE_US: Final = tuple(0 if sonar % 2 else EARLY_US for sonar in range(SONARS))
ALL: Final = (1 << SONARS) - 1

ROUNDING: Final = float(3 * 2**51)
"""A number plus this minus this is rounded as by `round`, which would dominate the ring's cost."""


class Reading(NamedTuple):
    """Range per sonar in millimetres (0 without an echo), and bit fields; bit i is sonar i."""

    range_mm: tuple[int, ...]
    valid: int
    echo: int


SILENT: Final = Reading((0,) * SONARS, ALL, 0)


class Ring:
    """Convert the nearest surface in each cone into readings, with noise and faults."""

    def __init__(self, body: Body, noise: Noise, seed: int, robot: int) -> None:
        self._rim_m = body.radius_m
        self._least_m, self._most_m = body.sonar_min_m, body.sonar_max_m
        self._least_nearness = 1.0 / (body.sonar_max_m + body.radius_m)
        self._least_mm, self._most_mm = round(self._least_m * 1e3), round(self._most_m * 1e3)
        self._sigma_m, self._sigma_ratio = noise.range_sigma_m, noise.range_sigma_ratio
        self._lost = noise.dropout_probability
        self._untrue = noise.dropout_probability + noise.ghost_probability
        self._errors = gaussian_rows(seed, robot, "sonar range", SONARS)
        self._chances = uniform_rows(seed, robot, "sonar echo", SONARS)
        self._ghosts = uniform_rows(seed, robot, "sonar ghost", SONARS)
        self._fault_chances = uniform_rows(seed, robot, "sonar fault", SONARS)
        self._last = SILENT

    def read(self, nearness: list[float], trouble: SonarFaults | None) -> Reading:
        """Return one scan; `nearness` per sonar in the order of `raycast.ORDER`."""
        reading = self._measured(nearness)
        if trouble is not None:
            reading = self._disturbed(reading, trouble)
        self._last = reading
        return reading

    def _measured(self, nearness: list[float]) -> Reading:
        errors, chances, ghosts = self._errors.next(), self._chances.next(), self._ghosts.next()
        range_mm = [0] * SONARS
        echo = 0
        least_nearness, rim_m, most_m = self._least_nearness, self._rim_m, self._most_m
        least_mm, most_mm, untrue = self._least_mm, self._most_mm, self._untrue
        sigma_m, sigma_ratio = self._sigma_m, self._sigma_ratio
        for place in range(SONARS):
            sonar, near = ORDER[place], nearness[place]
            chance = chances[sonar]
            if chance < untrue:
                if chance < self._lost:
                    continue
                range_m = 1.0 / near - rim_m if near >= least_nearness else most_m
                range_m = self._least_m + ghosts[sonar] * (range_m - self._least_m)
            elif near >= least_nearness:
                range_m = 1.0 / near - rim_m
                range_m += errors[sonar] * (sigma_m + sigma_ratio * range_m)
            else:
                continue
            # Comparisons: min() and max() would dominate the cost of the ring.
            read_mm = int(range_m * 1e3 + ROUNDING - ROUNDING)
            if read_mm > most_mm:
                read_mm = most_mm
            range_mm[sonar] = read_mm if read_mm > least_mm else least_mm
            echo |= 1 << sonar
        return Reading(tuple(range_mm), ALL, echo)

    def _disturbed(self, reading: Reading, trouble: SonarFaults) -> Reading:
        range_mm, valid, echo = list(reading.range_mm), reading.valid, reading.echo
        chances = self._fault_chances.next()
        for sonar in range(SONARS):
            bit = 1 << sonar
            offset_m, fixed_m = trouble.offset_m[sonar], trouble.fixed_m[sonar]
            dropout = trouble.dropout[sonar]
            if offset_m is not None and echo & bit:
                range_mm[sonar] = _within(range_mm[sonar] + round(offset_m * 1e3))
            if dropout is not None and chances[sonar] < dropout:
                range_mm[sonar], echo = 0, echo & ~bit
            if fixed_m is not None:
                range_mm[sonar], echo = _within(round(fixed_m * 1e3)), echo | bit
            if trouble.frozen[sonar]:
                range_mm[sonar] = self._last.range_mm[sonar]
                echo = (echo & ~bit) | (self._last.echo & bit)
            if trouble.dead[sonar]:
                range_mm[sonar], valid, echo = 0, valid & ~bit, echo & ~bit
        return Reading(tuple(range_mm), valid, echo)


def _within(range_mm: int) -> int:
    """Limit a range to the wire field; a faulty sonar has no other limit."""
    return max(0, min(65535, range_mm))
