"""Read a ROS map as map_server does: a .yaml file and the .pgm picture that it names.

A pixel is free if its occupancy is below free_thresh; occupied and unknown pixels are blocked. The
.yaml file has flat keys with a text, a number or a list of numbers: map savers write no other YAML.
Pictures are PGM, as text (P2) or bytes (P5). Anything else is refused with its line.
"""

import re
from math import pi
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.imports.cells import MAX_COORDINATE_M, Cells
from plant.model.errors import read_bytes, read_text, refuse
from runtime.errors import not_a_number

Value: TypeAlias = str | list[str]

MAX_YAML_BYTES: Final = 100_000
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
            raise self.refuse(key, not_a_number(text), example) from None
        if not low <= value <= high:
            raise self.refuse(key, f"{text} is out of range ({low:g} to {high:g})", example)
        return value


def load_map_yaml(path: Path) -> MapYaml:
    """Read a file; raise WorldError."""
    return parse_map_yaml(read_text(path, MAX_YAML_BYTES), str(path))


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


MAX_PICTURE_BYTES: Final = 100_000_000
MAX_SIDE: Final = 20_000
MAX_VALUE: Final = 65_535
TOKEN: Final = re.compile(rb"(?:\s|#[^\n\r]*[\n\r])*([^\s#]+)")
FIX: Final = "save it as PGM, P5 (bytes) or P2 (text)"
OTHERS: Final = {
    b"P1": "a PBM picture (black and white, as text)",
    b"P3": "a PPM picture (colours, as text)",
    b"P4": "a PBM picture (black and white)",
    b"P6": "a PPM picture (colours)",
    b"P7": "a PAM picture",
    b"\x89P": "a PNG picture",
    b"\xff\xd8": "a JPEG picture",
    b"BM": "a BMP picture",
    b"GI": "a GIF picture",
}


def parse_pgm(data: bytes, file: str) -> NDArray[np.float64]:
    """Return rows of brightness from 0 to 1, the first at the top; raise WorldError."""
    magic = data[:2]
    if magic not in (b"P2", b"P5") or not data[2:3].isspace():
        found = OTHERS.get(magic, f"starts with {data[:8]!r}" if data else "empty")
        raise refuse(file, "format", f"no PGM picture: {found}", FIX)
    numbers, end = _header(data, file)
    width, height, most = numbers
    if magic == b"P2":
        values = _as_text(data[end:], file, width * height)
    else:
        values = _as_bytes(data[end + 1 :], file, width * height, most)
    if values.max(initial=0) > most:
        reason = f"a value of {values.max()}, but maxval is {most}"
        raise refuse(file, "raster", reason, "write the largest value as maxval")
    whiteness: NDArray[np.float64] = values.reshape(height, width) / most
    return whiteness


def _header(data: bytes, file: str) -> tuple[list[int], int]:
    """Return width, height and maxval, and the offset behind them."""
    numbers: list[int] = []
    end = 2
    for key, most in (("width", MAX_SIDE), ("height", MAX_SIDE), ("maxval", MAX_VALUE)):
        match = TOKEN.match(data, end)
        word = match[1] if match else b""
        if match is None or not word.isdigit() or len(word) > 9 or not 1 <= int(word) <= most:
            found = repr(word[:20].decode("ascii", "replace")) if word else "nothing: the file ends"
            raise refuse(file, key, f"found {found}", f"write a whole number of 1 to {most}")
        numbers.append(int(word))
        end = match.end()
    if not data[end : end + 1].isspace():
        raise refuse(file, "raster", "missing: the file ends", "is the file cut? save it again")
    return numbers, end


def _as_text(text: bytes, file: str, count: int) -> NDArray[np.int64]:
    words = re.sub(rb"#[^\n\r]*", b"", text).split()
    _check_count(file, len(words), count, "numbers")
    for word in words:
        if not word.isdigit() or len(word) > 9:
            shown = word[:20].decode("ascii", "replace")
            raise refuse(file, "raster", f"{shown!r} is no whole number", "save it as P2 again")
    return np.array(words, dtype=np.bytes_).astype(np.int64)


def _as_bytes(data: bytes, file: str, count: int, most: int) -> NDArray[np.int64]:
    """Return values of one byte, or two, big-endian, if maxval is above 255."""
    wide = 1 if most < 256 else 2
    needed = count * wide
    if len(data) > needed and not data[needed:].strip():
        data = data[:needed]
    _check_count(file, len(data), needed, "bytes")
    return np.frombuffer(data, dtype=">u1" if wide == 1 else ">u2").astype(np.int64)


def _check_count(file: str, found: int, needed: int, what: str) -> None:
    if found != needed:
        reason = f"{found} {what}, but width times height needs {needed}"
        raise refuse(file, "raster", reason, "is the file cut? save it again")


MODES: Final = ("trinary", "scale")
TRUE: Final = ("1", "true", "yes")
FALSE: Final = ("0", "false", "no")


def load_ros_map(path: Path) -> Cells:
    """Return the map's cells, in its frame, without a blocked rim; raise WorldError."""
    settings = load_map_yaml(path)
    image = path.parent / settings.text("image", "map.pgm")
    cell_m = settings.number("resolution", "0.05", 0.001, 10.0)
    x_m, y_m, yaw_rad = settings.numbers("origin", "[0.0, 0.0, 0.0]", 3, MAX_COORDINATE_M)
    if abs(yaw_rad) > 2.0 * pi:
        raise settings.refuse(
            "origin", f"a yaw of {yaw_rad:g}", "[0.0, 0.0, 0.0], the yaw in radians"
        )
    free_below, negated = _threshold(settings), _negated(settings)
    if image.suffix.lower() != ".pgm":
        reason = f"{image.name} is no .pgm file"
        raise settings.refuse("image", reason, "map.pgm, and save the picture as PGM")
    whiteness = parse_pgm(read_bytes(image, MAX_PICTURE_BYTES), str(image))
    occupancy = whiteness if negated else 1.0 - whiteness
    free = occupancy < free_below
    if not free.any():
        fix = "check negate and free_thresh"
        raise refuse(
            str(path), "free_thresh", "no pixel is free", fix, settings.line("free_thresh")
        )
    return Cells(~free[::-1], cell_m, (x_m, y_m), yaw_rad).trimmed()


def _threshold(settings: MapYaml) -> float:
    """Return free_thresh, after a check of the keys that belong to it."""
    free_below = settings.number("free_thresh", "0.196", 0.0, 1.0)
    occupied_above = settings.number("occupied_thresh", "0.65", 0.0, 1.0)
    if free_below > occupied_above:
        raise settings.refuse("free_thresh", f"above occupied_thresh ({occupied_above:g})", "0.196")
    mode = settings.text("mode", "trinary") if "mode" in settings else MODES[0]
    if mode not in MODES:
        raise settings.refuse("mode", f"{mode!r} is none of {', '.join(MODES)}", "trinary")
    return free_below


def _negated(settings: MapYaml) -> bool:
    word = settings.text("negate", "0").lower()
    if word not in (*TRUE, *FALSE):
        raise settings.refuse("negate", f"{word!r} is neither 0 nor 1", "0")
    return word in TRUE
