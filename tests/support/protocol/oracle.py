"""pymavlink's generated code, as the codec's oracle."""

from typing import Any

from protocol.dialect.generate import oracle
from protocol.wire.message import LAYOUT, Field, Message


def frame_by_pymavlink(message: Message, system: int, component: int, sequence: int) -> bytes:
    mav = oracle().MAVLink(None, srcSystem=system, srcComponent=component)
    mav.seq = sequence
    return bytes(theirs(message).pack(mav))


def theirs(message: Message) -> Any:
    layout = LAYOUT[type(message).__name__]
    cls = oracle().mavlink_map[layout.number]
    return cls(**{f.name: to_theirs(f, getattr(message, f.name)) for f in layout.fields})


def to_theirs(field: Field, value: Any) -> Any:
    return value.encode() if field.is_text else value


def read_by_pymavlink(frame: bytes) -> Any:
    return oracle().MAVLink(None).decode(bytearray(frame))


def value_read(field: Field, message: Any) -> Any:
    """Return what pymavlink read, in our terms; its text is ASCII with replacements."""
    if field.is_text:
        return getattr(message, f"_{field.name}_raw").rstrip(b"\0").decode()
    value = getattr(message, field.name)
    return tuple(value) if field.length else value
