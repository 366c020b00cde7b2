"""The committed list of mutants that no test can notice, each with the reason."""

from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Final

import msgspec

from verification.mutation.mutants import Identity

FILE: Final = Path(__file__).with_name("equivalent.toml")


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mutants of a function that are equivalent for the same reason.

    `changes` are pairs of what was and what is there, as the report prints them.
    """

    module: str
    scope: str
    changes: tuple[tuple[str, str], ...]
    why: str

    @property
    def identities(self) -> list[Identity]:
        return [Identity(self.module, self.scope, was, now) for was, now in self.changes]


class Entries(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    equivalent: tuple[Entry, ...] = ()


def load(file: Path = FILE) -> tuple[Entry, ...]:
    """Read the list; raise msgspec.ValidationError where it is malformed."""
    return msgspec.toml.decode(file.read_bytes(), type=Entries).equivalent


def mistakes(
    entries: Iterable[Entry], modules: Collection[str], survivors: Iterable[Identity]
) -> list[str]:
    """Return what is wrong with the entries of these modules.

    An entry without a reason is wrong, so is one that appears twice, and one that names no mutant
    that has survived: its code has changed, or a test kills the mutant.
    """
    alive = set(survivors)
    chosen = [entry for entry in entries if entry.module in modules]
    listed = Counter(identity for entry in chosen for identity in entry.identities)
    return [
        *(f"without a reason: {entry.module} {entry.scope}" for entry in chosen if not entry.why),
        *(f"listed twice: {identity}" for identity, times in listed.items() if times > 1),
        *(f"stale: {identity}" for identity in listed if identity not in alive),
    ]
