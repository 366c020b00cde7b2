"""The one table of decoders: every place where bytes of others, or of a person, come in."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from benchmarks.fuzz_keys import KEYS
from benchmarks.fuzz_logs import LOGS
from benchmarks.fuzz_missions import MISSION
from benchmarks.fuzz_rows import ROWS
from benchmarks.fuzz_settings import SETTING
from benchmarks.fuzz_target import Target
from benchmarks.fuzz_typed import TYPED
from benchmarks.fuzz_wire import WIRE
from benchmarks.fuzz_worlds import WORLDS

TARGETS: Final[Mapping[str, Target]] = MappingProxyType(
    {one.name: one for one in (*WIRE, *WORLDS, *MISSION, *SETTING, *LOGS, *TYPED, *KEYS, *ROWS)}
)
