"""The schemas of Foxglove messages have the fields of the official SDK."""

import inspect
import json
from collections.abc import Iterator
from typing import Any

import foxglove.messages as sdk

from ground.recording.foxglove_schemas import SHAPES
from tests.support.each import each

OF_FOXGLOVE = "foxglove."
BASIC = ("time", "duration")


def all_in(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield every named object in a schema."""
    if "properties" in schema and schema.get("title") not in BASIC:
        yield schema
    inside = [*schema.get("properties", {}).values()]
    inside += [schema["items"]] if "items" in schema else []
    for inner in inside:
        yield from all_in(inner)


@each("name", sorted(SHAPES))
def test_schema_fields_match_the_sdk(name: str) -> None:
    assert SHAPES[name].name == name
    found = list(all_in(json.loads(SHAPES[name].text)))
    assert found
    for schema in found:
        title = schema["title"].removeprefix(OF_FOXGLOVE)
        fields = set(inspect.signature(getattr(sdk, title)).parameters)
        assert set(schema["properties"]) == fields, title
        assert set(schema["required"]) == fields, title
