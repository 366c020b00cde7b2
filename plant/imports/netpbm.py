"""Read grey pictures in the PGM format, as text (P2) or bytes (P5); refuse other formats."""

import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant.imports.refusal import read_bytes, refuse

MAX_BYTES: Final = 100_000_000
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


def load_pgm(path: Path) -> NDArray[np.float64]:
    """Return rows of brightness from 0 to 1, the first at the top; raise WorldError."""
    return parse_pgm(read_bytes(path, MAX_BYTES), str(path))


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
