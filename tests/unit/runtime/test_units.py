"""The number of nanoseconds in a second is defined once."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = [
    "runtime",
    "protocol",
    "robot",
    "firmware",
    "plant",
    "ground",
    "gateways",
    "vehicle_check",
    "study",
    "checks",
]
WRITTEN_DOWN = re.compile(
    r"^(NS_PER_\w+|MS|SECOND)\b.*= *[\d(]|\b[a-z]\w* [*/] 1e9\b", re.MULTILINE
)
PORTABLE = "robot/core/"
"""Modules that run alone on a microcontroller."""


def test_only_one_module_defines_the_units_of_time() -> None:
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    paths = {
        file.relative_to(ROOT).as_posix()
        for file in files
        if WRITTEN_DOWN.search(file.read_text(encoding="utf-8"))
    }
    assert {path for path in paths if not path.startswith(PORTABLE)} == {"runtime/units.py"}
