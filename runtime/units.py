"""Nanoseconds, the unit of all stamps and ages, and the period of the control cycle."""

from typing import Final

NS_PER_US: Final = 1_000
NS_PER_MS: Final = 1_000_000
NS_PER_S: Final = 1_000_000_000
MM_PER_M: Final = 1000.0

PERIOD_MS: Final = 50
"""The control period: from sensor frames to sensor frames, with one wheel command between."""

PERIOD_NS: Final = PERIOD_MS * NS_PER_MS
PERIOD_S: Final = PERIOD_NS / NS_PER_S
CONTROL_HZ: Final = 1000.0 / PERIOD_MS

UINT32: Final = 0xFFFFFFFF
"""Ticks and commands are counted in 32 bits; the count wraps to 0."""
