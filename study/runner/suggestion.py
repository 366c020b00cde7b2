"""What to say of a name that is not there: which one was meant, or which there are."""

from collections.abc import Iterable
from difflib import get_close_matches


def unknown(kind: str, name: str, names: Iterable[str]) -> str:
    """`kind`: what it should have been, as in "no such navigator"."""
    known = list(names)
    near = get_close_matches(name, known, n=1)
    meant = f"did you mean {near[0]!r}? " if near else ""
    return f"no such {kind}: {name!r}; {meant}there are {', '.join(known)}"
