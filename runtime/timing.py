"""Times that robot and plant must agree on."""

from typing import Final

from runtime.units import NS_PER_MS

PERIOD_MS: Final = 50
"""The control period: from sensor frames to sensor frames, with one wheel command between."""

PERIOD_NS: Final = PERIOD_MS * NS_PER_MS
CONTROL_HZ: Final = 1000.0 / PERIOD_MS

UINT32: Final = 0xFFFFFFFF
"""Ticks and commands are counted in 32 bits; the count wraps to 0."""
