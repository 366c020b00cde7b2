"""Build JSON schemas of the contents of a recording; those of messages follow from their layout."""

import json
from functools import cache
from typing import Final, NamedTuple, TypeAlias

from protocol.wire.message import LAYOUT, Field, Message

Json: TypeAlias = dict[str, object]


class Schema(NamedTuple):
    """A name and a JSON schema as text."""

    name: str
    text: bytes


def record(title: str, **properties: Json) -> Json:
    """Return the schema of an object with all of these properties."""
    return {
        "title": title,
        "type": "object",
        "properties": properties,
        "required": list(properties),
    }


def many(items: Json) -> Json:
    """Return the schema of an array."""
    return {"type": "array", "items": items}


def named(content: Json) -> Schema:
    """Return a schema under its title."""
    return Schema(str(content["title"]), json.dumps(content).encode())


@cache
def schema_of(message: type[Message]) -> Schema:
    """Return the schema of a message; floating-point values may be null."""
    layout = LAYOUT[message.__name__]
    fields = {field.name: _field(field) for field in layout.fields}
    return named(record(f"sidestep.{message.__name__}", **fields))


def _field(field: Field) -> Json:
    if field.is_text:
        return {"type": "string", "maxLength": field.length}
    number = _number(field)
    if not field.length:
        return number
    return many(number) | {"minItems": field.length, "maxItems": field.length}


def _number(field: Field) -> Json:
    if field.limits is None:
        return {"type": ["number", "null"]}
    low, high = field.limits
    return {"type": "integer", "minimum": low, "maximum": high}


KEY_SCHEMA: Final = named(record("sidestep.FrameKey", key={"type": "string"}))
