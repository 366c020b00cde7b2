"""Times that robot and plant must agree on."""

from typing import Final

CONTROL_HZ: Final = 20.0
PERIOD_MS: Final = 50
PERIOD_NS: Final = 50_000_000
"""The control period: from sensor frames to sensor frames, with one wheel command between."""

UINT32: Final = 0xFFFFFFFF
"""Ticks and commands are counted in 32 bits; the count wraps to 0."""
