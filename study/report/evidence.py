"""Figures that other tools measured, read from the JSON files beside their pages.

`python -m study.people` writes those of crowds, `python -m checks.site.published_maps` those of
published maps, and `python -m checks.speed.board.measure` the cost on the emulated board.
"""

from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from runtime.errors import UserError
from study.intervals import Interval, Proportion

PEOPLE: Final = "people.json"
MAPS: Final = "published-maps.json"
BOARD: Final = "microcontroller/cost.json"
CYLINDERS: Final = "BARN"
"""Name of the published maps of cylinders."""

GRID_MAPS: Final = "Moving AI"
"""Name of the published grid maps."""


class CrowdResult(msgspec.Struct, frozen=True, kw_only=True):
    """Trials in one family of crowds; counts of trials in which a robot was touched.

    `own`: by its own motion. `standing_touched` and `omniscient_touched` are of the two baselines
    in the same trials.
    """

    family: str
    navigator: str
    noise: str
    seed: int
    trials: int
    touched: int
    own: int
    standing_touched: int
    omniscient_touched: int


class Crowds(msgspec.Struct, frozen=True):
    """The file of crowds."""

    crowds: list[CrowdResult] = []


class MapResult(msgspec.Struct, frozen=True, kw_only=True):
    """Trials in one set of published maps at one noise level.

    `arrived` counts arrivals without a contact, `touched` trials with one, however they ended.
    `unreachable` and `lost` count these ends, `other` the trials in none of the others. The score
    is a mean with its interval; None where only the mean is known.
    """

    maps: str
    scale: float
    noise: str
    trials: int
    arrived: int
    touched: int
    unreachable: int
    lost: int
    other: int
    score: float
    score_low: float | None = None
    score_high: float | None = None

    @property
    def arrivals(self) -> Proportion:
        """The share that arrived and touched nothing."""
        return Proportion(self.arrived, self.trials)

    @property
    def score_interval(self) -> Interval:
        """The interval of the mean score; unbounded where it is not known."""
        if self.score_low is None or self.score_high is None:
            return Interval(-inf, inf)
        return Interval(self.score_low, self.score_high)

    @property
    def wronged(self) -> Proportion:
        """The share that was called unreachable; every goal in these maps can be reached."""
        return Proportion(self.unreachable, self.trials)


class PublishedMaps(msgspec.Struct, frozen=True):
    """The file of published maps."""

    maps: list[MapResult] = []


class BoardTick(msgspec.Struct, frozen=True):
    """Worst tick of one drive or scenario."""

    navigator: str
    whole_ms: float


class BoardCost(msgspec.Struct, frozen=True):
    """The file of the cost on the board; `state_bytes` is the largest state of each navigator."""

    drives: list[BoardTick] = []
    hardest: list[BoardTick] = []
    state_bytes: dict[str, int] = {}

    def worst_ms(self, navigator: str) -> list[float]:
        """Return the worst tick of each drive and scenario of a navigator."""
        every = (*self.drives, *self.hardest)
        return [one.whole_ms for one in every if one.navigator == navigator]


@dataclass(frozen=True, slots=True)
class MeasuredEvidence:
    """Figures of other tools, empty for a file that was not read."""

    crowds: tuple[CrowdResult, ...] = ()
    maps: tuple[MapResult, ...] = ()
    board: BoardCost = field(default_factory=BoardCost)

    def of_maps(self, name: str) -> list[MapResult]:
        """Return the results in one set of published maps, in the order of the file."""
        return [one for one in self.maps if one.maps == name]


Kind = TypeVar("Kind", Crowds, PublishedMaps, BoardCost)


def read_evidence(directory: Path | None) -> MeasuredEvidence:
    """Read the files in a directory; one that is missing leaves its figures empty.

    Raises UserError for a directory that does not exist and for a file of another form.
    """
    if directory is None:
        return MeasuredEvidence()
    if not directory.is_dir():
        raise UserError(f"--evidence {directory}: no such directory")
    return MeasuredEvidence(
        crowds=tuple(_read(directory / PEOPLE, Crowds).crowds),
        maps=tuple(read_maps(directory / MAPS)),
        board=_read(directory / BOARD, BoardCost),
    )


def read_maps(path: Path) -> list[MapResult]:
    """Read the results in published maps, none without the file; raise UserError."""
    return _read(path, PublishedMaps).maps


def _read(path: Path, kind: type[Kind]) -> Kind:
    if not path.exists():
        return kind()
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except msgspec.DecodeError as error:
        raise UserError(f"{path}: {error}; write this file again with its own tool") from None
