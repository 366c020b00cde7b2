"""Names and numbers of the navigators for studies only."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

ORACLE_GRID: Final = 1001
"""Not a number of the dialect, so that no robot and no message has it."""

STUDY_ONLY: Final[Mapping[str, int]] = MappingProxyType({"oracle_grid": ORACLE_GRID})
"""Navigators with means that a robot does not have: bounds for a comparison."""
