"""Names of `typing`, with substitutes for MicroPython, which has no such module."""

try:
    from typing import Any, Final, NamedTuple, Protocol
except ImportError:  # MicroPython: annotations cost nothing; these four names suffice
    from collections import namedtuple

    Any = Final = Protocol = object  # type: ignore[assignment, misc]

    def NamedTuple(name, fields):  # type: ignore[no-untyped-def, no-redef]  # noqa: N802
        """Return a named tuple without types."""
        return namedtuple(name, [field for field, _ in fields])


__all__ = ["Any", "Final", "NamedTuple", "Protocol"]
