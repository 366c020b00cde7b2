"""Read the .yaml file of a ROS map: flat keys with a text, a number or a list of numbers.

Map savers write no other YAML, so no YAML library is needed. Anything else is refused with its
line.
"""

import re
from pathlib import Path
from typing import Final, TypeAlias

from plant.imports.refusal import read_text, refuse

Value: TypeAlias = str | list[str]

MAX_BYTES: Final = 100_000
PAIR: Final = re.compile(r"([A-Za-z_]\w*)\s*:(?:\s+(.*))?")
QUOTED: Final = re.compile(r"""(?:"([^"\\]*)"|'([^']*)')\s*(?:#.*)?""")
COMMENT: Final = re.compile(r"(?:^|\s)#.*")


class MapYaml:
    """The values by key as text, with their lines."""

    def __init__(self, file: str) -> None:
        self.file = file
        self._values: dict[str, tuple[Value, int]] = {}

    def put(self, key: str, value: Value, line: int) -> None:
        """Add a key; raise WorldError if it is already present."""
        if key in self._values:
            raise refuse(self.file, key, "given twice", "keep one of them", line)
        self._values[key] = (value, line)

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def line(self, key: str) -> int:
        """Return the line of a key."""
        return self._values[key][1]

    def text(self, key: str, example: str) -> str:
        """Return the text of a key; raise WorldError."""
        value = self._value(key, example)
        if isinstance(value, list) or not value:
            raise self.refuse(key, f"expected text, found {value or 'nothing'}", example)
        return value

    def number(self, key: str, example: str, low: float, high: float) -> float:
        """Return the number of a key within limits; raise WorldError."""
        value = self._value(key, example)
        if isinstance(value, list):
            raise self.refuse(key, "expected a number, found a list", example)
        return self._number(key, value, example, low, high)

    def numbers(self, key: str, example: str, count: int, most: float) -> list[float]:
        """Return the list of numbers of a key; raise WorldError."""
        value = self._value(key, example)
        if not isinstance(value, list) or len(value) != count:
            found = f"{len(value)} values" if isinstance(value, list) else repr(value)
            raise self.refuse(key, f"expected {count} numbers, found {found}", example)
        return [self._number(key, one, example, -most, most) for one in value]

    def refuse(self, key: str, reason: str, example: str) -> Exception:
        """Return the WorldError for a key."""
        line = self._values[key][1] if key in self._values else None
        return refuse(self.file, key, reason, f"write {key}: {example}", line)

    def _value(self, key: str, example: str) -> Value:
        if key not in self._values:
            raise refuse(self.file, key, "missing", f"add {key}: {example}")
        return self._values[key][0]

    def _number(self, key: str, text: str, example: str, low: float, high: float) -> float:
        try:
            value = float(text)
        except ValueError:
            raise self.refuse(key, f"{text!r} is no number", example) from None
        if not low <= value <= high:
            raise self.refuse(key, f"{text} is out of range ({low:g} to {high:g})", example)
        return value


def load_map_yaml(path: Path) -> MapYaml:
    """Read a file; raise WorldError."""
    return parse_map_yaml(read_text(path, MAX_BYTES), str(path))


def parse_map_yaml(text: str, file: str) -> MapYaml:
    """Parse a text; raise WorldError unless its keys are flat."""
    found = MapYaml(file)
    lines = [(number, line) for number, line in enumerate(text.split("\n"), 1) if _says(line)]
    at = 0
    while at < len(lines):
        number, line = lines[at]
        at += 1
        match = PAIR.fullmatch(line.rstrip())
        if match is None:
            fix = "write one key: value a line, as map_saver does"
            raise refuse(file, "yaml", f"cannot read {line.strip()[:40]!r}", fix, number)
        value = _scalar(match[2] or "")
        items = []
        while not value and at < len(lines) and lines[at][1].lstrip().startswith("- "):
            items.append(_scalar(lines[at][1].lstrip()[2:]))
            at += 1
        found.put(match[1], items or _listed(value, match[1], file, number), number)
    return found


def _says(line: str) -> bool:
    return bool(COMMENT.sub("", line).strip()) and line.strip() not in ("---", "...")


def _scalar(text: str) -> str:
    text = text.strip()
    quoted = QUOTED.fullmatch(text)
    if quoted:
        return quoted[1] if quoted[1] is not None else quoted[2]
    return COMMENT.sub("", text).strip()


def _listed(value: str, key: str, file: str, line: int) -> Value:
    if not value.startswith("["):
        return value
    if not value.endswith("]"):
        raise refuse(file, key, "the list does not end on its line", "write ] at its end", line)
    inner = value[1:-1].strip()
    return [one.strip() for one in inner.split(",")] if inner else []
