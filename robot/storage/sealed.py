"""Read saved state only whole and unchanged: JSON with a checksum, from a regular file.

A file of an earlier version has no checksum. It is accepted, and gets one when it is next saved.
"""

import json
from pathlib import Path
from typing import Any, Final
from zlib import crc32

from runtime import files
from runtime.files import value_in

CHECKSUM: Final = "crc32"
SAVED: Final = "saved"
MAX_BYTES: Final = 1 << 20
"""The largest file: 256 mission items take 90 kB."""


def sealed(body: str) -> str:
    """Return a JSON text with its checksum, which holds for the values and not for the spaces."""
    return f'{{"{CHECKSUM}": "{checksum(value_in(body))}", "{SAVED}":\n{body}}}\n'


def checksum(value: object) -> str:
    """Return the CRC-32 of a JSON value in one order and notation."""
    return f"{crc32(json.dumps(value, sort_keys=True).encode()):08x}"


def unsealed(text: str) -> Any:
    """Return the value in a JSON text; ValueError if it is damaged."""
    value = value_in(text)
    if not isinstance(value, dict) or not value.keys() & {CHECKSUM, SAVED}:
        return value
    if value.keys() != {CHECKSUM, SAVED} or value[CHECKSUM] != checksum(value[SAVED]):
        raise ValueError("damaged: its checksum is wrong")
    return value[SAVED]


def text_in(path: Path) -> str:
    """Return the text of a state file; raise as `regular_file.text_in`."""
    return files.text_in(path, MAX_BYTES)
