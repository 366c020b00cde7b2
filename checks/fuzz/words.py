"""Words of the file formats, and files that take a parser very long."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

TOML_WORDS: Final = (
    *(b"[[", b"]]", b"[", b"]", b"{", b"}", b" = ", b",", b"\n", b"#", b'"', b'"""', b"'''", b"."),
    *(
        b"true",
        b"1979-05-27T07:32:00Z",
        b"07:32:00",
        b"\\u0000",
        b"\\uD800",
        b"\xff",
        b"\xef\xbb\xbf",
    ),
    *(b"[[obstacle]]\n", b"circle_m = ", b"polygon_m = ", b"wall_m = ", b"path_m = [[1, 1]]\n"),
    *(b"[robot]\n", b"[noise]\n", b"[[fault]]\n", b"[corpus]\n", b"[network]\n", b"[parameters]\n"),
    *(b"[[waypoint]]\n", b"[fence]\n", b"corners = ", b"heading_deg = ", b"x_m = ", b"a.b.c = 1\n"),
)
JSON_WORDS: Final = (
    *(b"[", b"]", b"{", b"}", b":", b",", b'"', b"null", b"true", b"NaN", b"Infinity", b"\\ud800"),
    *(b'"inclusion"', b'"circle"', b'"polygon"', b'"params"', b'"frame"', b'"items"', b'"name"'),
)


def from_file(name: str, read: Callable[[Path], object]) -> Callable[[bytes, Path], object]:
    """Return a function that writes the bytes to a file of this name and reads it."""

    def run(data: bytes, folder: Path) -> object:
        path = folder / name
        path.write_bytes(data)
        return read(path)

    return run


def toml_bombs() -> Sequence[bytes]:
    """Return deep, dotted and long TOML, which may take a parser very long."""
    corners = b"[fence]\ncorners = [" + b"[0,0],[1,0],[1,1]," * 5_000 + b"]"
    return [
        b"a = " + b"[" * 100_000,
        b"a = " + b"{a=" * 50_000,
        b"a = " + b"9" * 100_000,
        b"a = 0x" + b"f" * 200_000,
        b"a" + b".a" * 60_000 + b" = 1",
        b"[a" + b".a" * 60_000 + b"]",
        b"a = {" + b"a." * 50_000 + b"a = 1}",
        b"a = [" + b"1," * 100_000 + b"]",
        b"x = '" + b"\\" * 200_000,
        b"name = 'x'\nsize_m = [6.0, 4.0]\n" + b"[[obstacle]]\n" * 30_000,
        b"[[waypoint]]\nx_m = 1\ny_m = 1\n" + corners,
        b"[[waypoint]]\nx_m = 1\ny_m = 1\n" * 8_000,
    ]


def json_bombs() -> Sequence[bytes]:
    """Return deep JSON and long numbers."""
    return [
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b'{"a": ' + b"9" * 5000 + b"}",
        b'{"a": ' + b"9" * 4000 + b"}",
        b"[1e999, -1e999, NaN]",
    ]
