"""The committed list of mutants that no test can detect, each with the reason."""

from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Final

import msgspec

from checks.mutation.mutants import Identity

FILE: Final = Path(__file__).with_name("equivalent.toml")


class EquivalentMutants(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mutants of a function that are equivalent for the same reason.

    `changes` are pairs of the old and the new code, as the report prints them.
    """

    module: str
    scope: str
    changes: tuple[tuple[str, str], ...]
    why: str

    @property
    def identities(self) -> list[Identity]:
        """The mutants."""
        return [Identity(self.module, self.scope, was, now) for was, now in self.changes]


class Entries(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    equivalent: tuple[EquivalentMutants, ...] = ()


def load(file: Path = FILE) -> tuple[EquivalentMutants, ...]:
    """Read the list; raise msgspec.ValidationError if it is malformed."""
    return msgspec.toml.decode(file.read_bytes(), type=Entries).equivalent


def mistakes(
    entries: Iterable[EquivalentMutants], modules: Collection[str], survivors: Iterable[Identity]
) -> list[str]:
    """Return the errors in the entries of these modules.

    An entry is wrong if it has no reason, appears twice, or names no mutant that survived: then its
    code has changed, or a test kills the mutant.
    """
    alive = set(survivors)
    chosen = [entry for entry in entries if entry.module in modules]
    listed = Counter(identity for entry in chosen for identity in entry.identities)
    return [
        *(f"without a reason: {entry.module} {entry.scope}" for entry in chosen if not entry.why),
        *(f"listed twice: {identity}" for identity, times in listed.items() if times > 1),
        *(f"stale: {identity}" for identity in listed if identity not in alive),
    ]
