"""The times that robot and plant have to agree on."""

from typing import Final

CONTROL_HZ: Final = 20.0
PERIOD_MS: Final = 50
PERIOD_NS: Final = 50_000_000
"""The control period: senses, one wheel command, the next senses."""

UINT32: Final = 0xFFFFFFFF
"""Ticks and commands are counted in 32 bits; the count goes on at 0."""
