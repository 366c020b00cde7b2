"""The one table of decoders: every place where bytes of others, or of a person, come in."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from verification.fuzz.keys import KEYS
from verification.fuzz.logs import LOGS
from verification.fuzz.missions import MISSION
from verification.fuzz.rows import ROWS
from verification.fuzz.settings import SETTING
from verification.fuzz.target import Target
from verification.fuzz.typed import TYPED
from verification.fuzz.wire import WIRE
from verification.fuzz.worlds import WORLDS

TARGETS: Final[Mapping[str, Target]] = MappingProxyType(
    {one.name: one for one in (*WIRE, *WORLDS, *MISSION, *SETTING, *LOGS, *TYPED, *KEYS, *ROWS)}
)
