"""Any message of the dialect, and pymavlink's code as the codec's oracle."""

from typing import Any

from hypothesis import strategies as st

from protocol.dialect.generate import oracle
from protocol.wire.message import LAYOUT, Field, Message
from protocol.wire.messages import MESSAGES


def texts(size: int) -> st.SearchStrategy[str]:
    """Up to `size` bytes of UTF-8, without NUL."""
    characters = st.characters(exclude_characters="\0", codec="utf-8")
    return st.text(characters, max_size=size).filter(lambda text: len(text.encode()) <= size)


def numbers(field: Field) -> st.SearchStrategy[Any]:
    if field.limits is not None:
        return st.integers(*field.limits)
    return st.floats(width=32) if field.code == "f" else st.floats()


def values(field: Field) -> st.SearchStrategy[Any]:
    if field.is_text:
        return texts(field.length)
    if field.length:
        return st.tuples(*[numbers(field)] * field.length)
    return numbers(field)


def messages_of(cls: type[Message]) -> st.SearchStrategy[Message]:
    return st.builds(cls, **{f.name: values(f) for f in LAYOUT[cls.__name__].fields})


any_message = st.sampled_from(MESSAGES).flatmap(messages_of)


def wire_values(message: Message) -> list[object]:
    """Field values in a form in which NaN equals NaN."""
    return [repr(getattr(message, f.name)) for f in LAYOUT[type(message).__name__].fields]


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
