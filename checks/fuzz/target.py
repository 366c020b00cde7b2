"""A decoder as the fuzzer sees it, and how broken inputs are made from good ones.

A decoder takes bytes, and only allowed errors come out. Inputs are broken by bits, bytes, pieces,
words of the format, limit numbers, and files that take a parser very long. The same sample, seed
and number give the same bytes, so that each finding is reproducible.
"""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from random import Random
from struct import pack
from typing import Final, NamedTuple, TypeAlias

from plant.model.errors import WorldError
from runtime.errors import RemoteError, UserError

MOST_BYTES: Final = 1_000_000
MOST_COPIES: Final = 40
MOST_NESTED: Final = 3000
SELDOM: Final = 0.004
"""Share of inputs that are blown up: each costs as much as a thousand others."""

NUMBER: Final = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
NUMBERS: Final = (
    *(b"0", b"-0", b"1", b"-1", b"0.5", b"-0.0", b"1e-320", b"1e308", b"-1e308", b"1e999", b"nan"),
    *(b"inf", b"-inf", b"true", b"null", b"''", b"[]", b"{}", b"127", b"128", b"255", b"256"),
    *(b"32767", b"32768", b"65535", b"65536", b"2147483647", b"2147483648", b"-2147483649"),
    *(b"4294967295", b"4294967296", b"9223372036854775807", b"9223372036854775808"),
    *(
        b"18446744073709551615",
        b"18446744073709551616",
        b"1" + b"0" * 30,
        b"9" * 400,
        b"0x" + b"f" * 400,
    ),
)
WHOLE: Final = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
WIDE: Final = (*WHOLE, 0x7FFFFFFFFFFFFFFF, 0x8000000000000000, 0xFFFFFFFFFFFFFFFF)
SINGLES: Final = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-45,
    3.4e38,
    -3.4e38,
    float("nan"),
    float("inf"),
    float("-inf"),
)
OPENING: Final = (b"[", b"{", b"(", b'{"a":', b"[[", b"a.", b'"', b"'", b"-", b"\\", b"\n", b" ")


class Material(NamedTuple):
    """The material of mutations: good samples, and words of the format."""

    samples: Sequence[bytes]
    words: Sequence[bytes] = ()


Mutation = Callable[[bytes, Material, Random], bytes]


def mutate_sample(material: Material, random: Random) -> bytes:
    """Return a sample with one to eight mutations."""
    data = random.choice(material.samples)
    for _ in range(1 + min(int(random.expovariate(0.9)), 7)):
        data = random.choice(MUTATIONS)(data, material, random)
    if random.random() < SELDOM:
        data = blow_up(data, random)
    return data[:MOST_BYTES]


def _place(data: bytes, random: Random) -> int:
    return random.randrange(len(data) + 1)


def _piece(data: bytes, random: Random) -> tuple[int, int]:
    """Draw a range, mostly a short one."""
    begin = _place(data, random)
    return begin, begin + 1 + int(random.expovariate(1.0 / random.choice((3, 30, 300))))


def flip_a_bit(data: bytes, _: Material, random: Random) -> bytes:
    """Flip a bit."""
    if not data:
        return b"\x01"
    at = random.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << random.randrange(8)]) + data[at + 1 :]


def set_a_byte(data: bytes, _: Material, random: Random) -> bytes:
    """Set a byte."""
    at = _place(data, random)
    return data[:at] + bytes([random.randrange(256)]) + data[at + 1 :]


def cut_off(data: bytes, _: Material, random: Random) -> bytes:
    """Cut off the end."""
    return data[: _place(data, random)]


def cut_out(data: bytes, _: Material, random: Random) -> bytes:
    """Cut out a piece."""
    begin, end = _piece(data, random)
    return data[:begin] + data[end:]


def extend(data: bytes, _: Material, random: Random) -> bytes:
    """Append random bytes."""
    return data + random.randbytes(1 + random.randrange(20))


def put_noise(data: bytes, _: Material, random: Random) -> bytes:
    """Insert random bytes."""
    at = _place(data, random)
    return data[:at] + random.randbytes(1 + random.randrange(8)) + data[at:]


def put_a_word(data: bytes, material: Material, random: Random) -> bytes:
    """Insert a word, or overwrite with it."""
    at = _place(data, random)
    word = random.choice(material.words or OPENING)
    over = random.choice((0, len(word)))
    return data[:at] + word + data[at + over :]


def repeat(data: bytes, _: Material, random: Random) -> bytes:
    """Repeat a piece."""
    begin, end = _piece(data, random)
    return data[:begin] + data[begin:end] * (1 + random.randrange(MOST_COPIES)) + data[end:]


def splice(data: bytes, material: Material, random: Random) -> bytes:
    """Join the beginning and the end of another sample."""
    other = random.choice(material.samples)
    return data[: _place(data, random)] + other[_place(other, random) :]


def move(data: bytes, _: Material, random: Random) -> bytes:
    """Move a piece."""
    begin, end = _piece(data, random)
    rest = data[:begin] + data[end:]
    at = _place(rest, random)
    return rest[:at] + data[begin:end] + rest[at:]


def put_a_number(data: bytes, _: Material, random: Random) -> bytes:
    """Replace a number in digits by one at a limit."""
    found = list(NUMBER.finditer(data[:20_000]))
    if not found:
        return put_limit(data, Material(()), random)
    match = random.choice(found)
    return data[: match.start()] + random.choice(NUMBERS) + data[match.end() :]


def put_limit(data: bytes, _: Material, random: Random) -> bytes:
    """Overwrite bytes with a binary number at a limit."""
    code = random.choice("BHIQfd") if random.random() < 0.8 else "f"
    order = random.choice("<<>")
    limits = SINGLES if code in "fd" else WIDE
    size = {"B": 1, "H": 2, "I": 4, "Q": 8}.get(code, 0)
    value = random.choice(limits)
    packed = pack(order + code, value if not size else int(value) & ((1 << 8 * size) - 1))
    at = _place(data, random)
    return data[:at] + packed + data[at + len(packed) :]


def nest(data: bytes, _: Material, random: Random) -> bytes:
    """Insert many opening brackets."""
    at = _place(data, random)
    return data[:at] + random.choice(OPENING) * (1 + random.randrange(60)) + data[at:]


def blow_up(data: bytes, random: Random) -> bytes:
    """Insert a piece, or an opening bracket, very often."""
    at = _place(data, random)
    begin, end = _piece(data, random)
    piece = random.choice((random.choice(OPENING), data[begin:end] or b"0"))
    return data[:at] + piece * random.randrange(MOST_NESTED) + data[at:]


MUTATIONS: Final[tuple[Mutation, ...]] = (
    *(flip_a_bit, set_a_byte, cut_off, cut_out, extend, put_noise, put_a_word, put_a_word),
    *(repeat, splice, move, put_a_number, put_a_number, put_limit, nest),
)


Errors: TypeAlias = tuple[type[BaseException], ...]
REFUSALS: Final[Errors] = (UserError, RemoteError, WorldError)


def no_bombs() -> Sequence[bytes]:
    """Return no bombs."""
    return ()


@dataclass(frozen=True, kw_only=True)
class FuzzTarget:
    """A decoder: `run` gets the bytes and a folder for files; errors not in `allowed` are crashes.

    `samples` are good inputs, and `bombs` are known bad ones, which are tried first. `weight` is
    the share of inputs: a fast decoder gets more.
    """

    name: str
    samples: Callable[[], Sequence[bytes]]
    run: Callable[[bytes, Path], object]
    allowed: Errors = REFUSALS
    words: Sequence[bytes] = ()
    bombs: Callable[[], Sequence[bytes]] = no_bombs
    weight: int = 20

    @cached_property
    def good(self) -> tuple[bytes, ...]:
        """The good samples."""
        return tuple(self.samples())

    @cached_property
    def _bad(self) -> tuple[bytes, ...]:
        return tuple(self.bombs())

    def input(self, seed: int, index: int) -> bytes:
        """Return an input: samples and bombs unchanged, then reproducible mutations."""
        fixed = (*self.good, *self._bad)
        if index < len(fixed):
            return fixed[index]
        return mutate_sample(Material(self.good, self.words), Random(f"{seed}/{self.name}/{index}"))

    def accepts(self, data: bytes, folder: Path) -> bool:
        """Return False if the input is refused with an allowed error; others are raised."""
        with suppress(*self.allowed):
            self.run(data, folder)
            return True
        return False


TOML_WORDS: Final = (
    *(b"[[", b"]]", b"[", b"]", b"{", b"}", b" = ", b",", b"\n", b"#", b'"', b'"""', b"'''", b"."),
    *(
        *(b"true", b"1979-05-27T07:32:00Z", b"07:32:00", b"\\u0000", b"\\uD800", b"\xff"),
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
