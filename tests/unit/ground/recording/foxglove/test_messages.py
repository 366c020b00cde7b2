"""Our schemas of the well-known messages have the fields that the maker's own SDK knows."""

import inspect
import json
from collections.abc import Iterator
from typing import Any

import foxglove.messages as sdk
import pytest

from ground.recording.foxglove.schemas import SHAPES

OF_FOXGLOVE = "foxglove."
BASIC = ("time", "duration")


def all_in(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every object in a schema that has a name."""
    if "properties" in schema and schema.get("title") not in BASIC:
        yield schema
    inside = [*schema.get("properties", {}).values()]
    inside += [schema["items"]] if "items" in schema else []
    for inner in inside:
        yield from all_in(inner)


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_every_field_has_the_name_that_the_sdk_gives_it(name: str) -> None:
    assert SHAPES[name].name == name
    found = list(all_in(json.loads(SHAPES[name].text)))
    assert found
    for schema in found:
        title = schema["title"].removeprefix(OF_FOXGLOVE)
        fields = set(inspect.signature(getattr(sdk, title)).parameters)
        assert set(schema["properties"]) == fields, title
        assert set(schema["required"]) == fields, title
