"""Typing where there is typing, and the same names where there is none (MicroPython)."""

try:
    from typing import Any, Final, NamedTuple, Protocol
except ImportError:  # MicroPython: annotations are free there, these four names are all it needs
    from collections import namedtuple

    Any = Final = Protocol = object  # type: ignore[assignment, misc]

    def NamedTuple(name, fields):  # type: ignore[no-untyped-def, no-redef]
        return namedtuple(name, [field for field, _ in fields])


__all__ = ["Any", "Final", "NamedTuple", "Protocol"]
