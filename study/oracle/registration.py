"""Put a study-only navigator into the robot's table while a trial runs."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Final

from robot.core.navigators.registry import NAVIGATORS, Navigator
from study.oracle import oracle_grid
from study.oracle.names import ORACLE_GRID

STUDY_NAVIGATORS: Final[Mapping[int, Navigator]] = MappingProxyType(
    {ORACLE_GRID: Navigator(oracle_grid.Memory, oracle_grid.step, True)}
)


@contextmanager
def registered(number: int) -> Iterator[None]:
    """Register a navigator if it is for studies only, and remove it afterwards."""
    if number not in STUDY_NAVIGATORS or number in NAVIGATORS:
        yield
        return
    NAVIGATORS[number] = STUDY_NAVIGATORS[number]
    try:
        yield
    finally:
        del NAVIGATORS[number]
