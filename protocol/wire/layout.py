"""Wire layout of every message by class name, parsed from the generated table."""

from typing import Final, NamedTuple

from protocol.dialect.layouts import LAYOUTS

CODE_BITS: Final = {"B": 8, "b": 8, "H": 16, "h": 16, "I": 32, "i": 32, "Q": 64, "q": 64}


class Field(NamedTuple):
    """One field: `length` elements of struct code `code`, or a scalar when `length` is 0."""

    name: str
    code: str
    length: int

    @property
    def is_text(self) -> bool:
        """Return whether the field is a text."""
        return self.code == "s"

    @property
    def limits(self) -> tuple[int, int] | None:
        """Smallest and largest value of an integer field; None for other fields."""
        if self.code not in CODE_BITS:
            return None
        bits = CODE_BITS[self.code]
        return (
            (-(1 << bits - 1), (1 << bits - 1) - 1) if self.code.islower() else (0, (1 << bits) - 1)
        )


class Layout(NamedTuple):
    """A message: its name in the dialect, id, crc_extra and fields in wire order."""

    name: str
    number: int
    crc_extra: int
    fields: tuple[Field, ...]


def class_name(name: str) -> str:
    """Return the Python class name of a message: SONAR_SCAN becomes SonarScan."""
    return "".join(part.capitalize() for part in name.split("_"))


def _field(word: str) -> Field:
    name, _, kind = word.partition(":")
    return Field(name, kind[-1], int(kind[:-1] or 0))


def _layout(line: str) -> Layout:
    name, number, crc_extra, *fields = line.split()
    return Layout(name, int(number), int(crc_extra), tuple(_field(word) for word in fields))


def _lines() -> list[str]:
    return LAYOUTS.replace("\n  ", " ").split("\n")[1:-1]


LAYOUT: Final = {class_name(layout.name): layout for layout in map(_layout, _lines())}
