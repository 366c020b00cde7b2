"""Parse the output of a ghost's process: its path tick by tick, then its result."""

from collections.abc import Iterable
from math import dist, isfinite
from typing import Any, Final, NamedTuple, TypeAlias

from runtime.files import value_in

Point: TypeAlias = tuple[float, float]

STEP_M: Final = 0.02
"""Distance below which points are omitted; they would not be visible on a map."""

PLACE: Final = ("true_x_m", "true_y_m")
FAILED: Final = "failed"


class PredictedPath(NamedTuple):
    """A path and its result: `outcome` as in `protocol.outcome`, or `failed`.

    `length_m` and `time_s` are None when the run did not start.
    """

    path_m: list[Point]
    outcome: str
    reason: str
    time_s: float | None = None
    length_m: float | None = None
    contacts: int = 0


class PathReader:
    """Accepts the output in pieces of any size; malformed lines are ignored."""

    def __init__(self) -> None:
        self.path_m: list[Point] = []
        self.outcome: dict[str, Any] | None = None
        self._rest = b""
        self._columns: tuple[int, ...] | None = None
        self._last: Point | None = None

    def take(self, data: bytes) -> None:
        """Process a piece of the output."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._take_lines(lines)

    def _take_lines(self, lines: Iterable[bytes]) -> None:
        for line in lines:
            if line.startswith(b"{"):
                self._take_outcome(line)
            elif self._columns is None:
                self._take_header(line)
            else:
                self._take_place(line.split(b","))

    def _take_header(self, line: bytes) -> None:
        names = line.decode(errors="replace").strip().split(",")
        if all(name in names for name in PLACE):
            self._columns = tuple(names.index(name) for name in PLACE)

    def _take_place(self, values: list[bytes]) -> None:
        try:
            x_m, y_m = (float(values[column]) for column in self._columns or ())
        except (ValueError, IndexError):
            return
        if not (isfinite(x_m) and isfinite(y_m)):
            return
        self._last = (x_m, y_m)
        if not self.path_m or dist(self.path_m[-1], self._last) >= STEP_M:
            self.path_m.append(self._last)

    def _take_outcome(self, line: bytes) -> None:
        """Store the outcome; the last point is always part of the path."""
        try:
            found = value_in(line)
        except ValueError:
            return
        if isinstance(found, dict) and isinstance(found.get("outcome"), str):
            self.outcome = found
            if self._last is not None and self.path_m[-1] != self._last:
                self.path_m.append(self._last)

    def course(self, otherwise: str) -> PredictedPath:
        """Return the result; `otherwise` is the reason when the process reported none."""
        outcome = self.outcome
        if outcome is None:
            return PredictedPath(list(self.path_m), FAILED, otherwise)
        return PredictedPath(
            list(self.path_m),
            outcome["outcome"],
            str(outcome.get("reason", "")),
            number(outcome.get("time_s")),
            number(outcome.get("path_m")),
            int(number(outcome.get("contacts")) or 0),
        )


def number(value: object) -> float | None:
    """Return a finite number, or None."""
    return float(value) if isinstance(value, int | float) and isfinite(value) else None
