"""Any message of the dialect, as hypothesis makes it up from the layout table."""

from typing import Any

from hypothesis import strategies as st

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
