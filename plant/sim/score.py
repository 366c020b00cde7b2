"""Evaluation of a run from ground truth: one entry per tick, summed up on request."""

from array import array
from hashlib import sha256
from typing import TYPE_CHECKING, Final

import numpy as np

from protocol.wire.messages import RunScore
from runtime.elementary import hypot
from runtime.timing import PERIOD_NS

if TYPE_CHECKING:
    from hashlib import _Hash

MAX_TICKS: Final = 1_000_000
COLUMNS: Final = 5
HASHED: Final = 4096
"""Ticks between kept states of the hash; limits the cost of a digest."""

_SIGNED: Final = np.dtype([("time_ns", "<u8"), ("pose", "<f8", 3)])


class Score:
    """The trajectory since the start, one row per tick, up to a million ticks (14 hours).

    After that the score stops: `RunScore.ticks` stays constant.
    """

    def __init__(
        self, start_ns: int, x_m: float, y_m: float, heading_rad: float, clearance_m: float
    ) -> None:
        self._start_ns = start_ns
        self._rows = array("d", (x_m, y_m, heading_rad, 0.0, clearance_m))
        self._contacts = array("L", (0,))
        self._own_contacts = array("L", (0,))
        self._touching = False
        self._hashes = [sha256()]

    @property
    def ticks(self) -> int:
        """The number of ticks scored."""
        return len(self._contacts) - 1

    def add(
        self,
        x_m: float,
        y_m: float,
        heading_rad: float,
        clearance_m: float,
        touching: bool,
        closing: bool = False,
    ) -> None:
        """Add a tick; `closing`: the robot itself moved towards the obstacle it touches."""
        if len(self._contacts) > MAX_TICKS:
            return
        rows = self._rows
        path_m = rows[-2] + hypot(x_m - rows[-5], y_m - rows[-4])
        least_m = rows[-1]
        if clearance_m < least_m:
            least_m = clearance_m
        rows.extend((x_m, y_m, heading_rad, path_m, least_m))
        begun = touching and not self._touching
        self._contacts.append(self._contacts[-1] + begun)
        self._own_contacts.append(self._own_contacts[-1] + (begun and closing))
        self._touching = touching
        if not self.ticks % HASHED:
            self._hashes.append(self._hash(self.ticks - HASHED, self.ticks))

    def until(self, until_ns: int) -> RunScore:
        """Return the score from the first tick to the one at `until_ns`, or to the newest."""
        ticks = max(0, min(self.ticks, (until_ns - self._start_ns) // PERIOD_NS))
        x_m, y_m, heading_rad, path_m, clearance_m = self._row(ticks)
        return RunScore(
            time_ns=self._start_ns + ticks * PERIOD_NS,
            ticks=ticks,
            contacts=self._contacts[ticks],
            own_contacts=self._own_contacts[ticks],
            x_m=x_m,
            y_m=y_m,
            heading_rad=heading_rad,
            path_m=path_m,
            min_clearance_m=clearance_m,
            digest=tuple(self._digest(ticks)),
        )

    def _row(self, tick: int) -> list[float]:
        return self._rows[tick * COLUMNS : (tick + 1) * COLUMNS].tolist()

    def _digest(self, ticks: int) -> bytes:
        """Return the SHA-256 over stamp and true pose of every tick but the first."""
        return self._hash(ticks - ticks % HASHED, ticks).digest()

    def _hash(self, kept: int, ticks: int) -> "_Hash":
        """Return the hash up to a tick, from the state kept at an earlier tick."""
        hashed = self._hashes[kept // HASHED].copy()
        signed = np.empty(ticks - kept, dtype=_SIGNED)
        stamps = np.arange(kept + 1, ticks + 1, dtype=np.uint64) * np.uint64(PERIOD_NS)
        signed["time_ns"] = stamps + np.uint64(self._start_ns)
        rows = self._rows[(kept + 1) * COLUMNS : (ticks + 1) * COLUMNS]
        signed["pose"] = np.array(rows).reshape(-1, COLUMNS)[:, :3]
        hashed.update(signed.tobytes())
        return hashed
