"""The table of decoders: every place that reads bytes of other programs or of users."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from verification.fuzz.keys import KEYS
from verification.fuzz.logs import LOGS
from verification.fuzz.missions import MISSION
from verification.fuzz.rows import ROWS
from verification.fuzz.settings import SETTING
from verification.fuzz.target import FuzzTarget
from verification.fuzz.typed import TYPED
from verification.fuzz.wire import WIRE
from verification.fuzz.worlds import WORLDS

TARGETS: Final[Mapping[str, FuzzTarget]] = MappingProxyType(
    {one.name: one for one in (*WIRE, *WORLDS, *MISSION, *SETTING, *LOGS, *TYPED, *KEYS, *ROWS)}
)
