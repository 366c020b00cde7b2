"""Put a study-only navigator into the robot's table while a trial runs."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Final

from robot.core.navigators.registry import NAVIGATORS, Navigator
from study.oracle import oracle_grid

ORACLE_GRID: Final = 1001
"""Its number: not of the dialect, so that no robot and no message has it."""

STUDY_ONLY: Final[Mapping[int, Navigator]] = MappingProxyType(
    {ORACLE_GRID: Navigator(oracle_grid.Memory, oracle_grid.step, True)}
)


@contextmanager
def registered(number: int) -> Iterator[None]:
    """Register a navigator if it is for studies only, and remove it afterwards."""
    if number not in STUDY_ONLY or number in NAVIGATORS:
        yield
        return
    NAVIGATORS[number] = STUDY_ONLY[number]
    try:
        yield
    finally:
        del NAVIGATORS[number]
