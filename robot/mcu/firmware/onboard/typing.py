"""The one function of `typing` that is called; annotations are dropped before."""

from collections import namedtuple


def NamedTuple(name, fields):  # noqa: N802
    """Return a named tuple without types."""
    return namedtuple(name, [field for field, _ in fields])
