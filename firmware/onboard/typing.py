"""Names of `typing` that the core imports; MicroPython has no such module.

CPython never imports this one.
"""

from collections import namedtuple

# Annotations are not evaluated on MicroPython, and a protocol only describes an interface.
Any = Final = Protocol = object


def NamedTuple(name, fields):  # noqa: N802
    """Return a named tuple without types."""
    return namedtuple(name, [field for field, _ in fields])
