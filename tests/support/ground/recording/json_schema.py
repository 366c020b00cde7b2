"""Check recordings with the part of JSON Schema that our schemas use."""

from typing import Any

TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "null": (type(None),),
}


def problem(schema: dict[str, Any], value: Any, where: str = "") -> str:
    """Return what violates the schema, and where; empty when all is valid."""
    kinds = schema.get("type", list(TYPES))
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if not isinstance(value, tuple(kind for name in kinds for kind in TYPES[name])):
        return f"{where}: {value!r} is none of {kinds}"
    if isinstance(value, bool) and "boolean" not in kinds:
        return f"{where}: {value!r} is a boolean"
    if isinstance(value, dict):
        return _of_object(schema, value, where)
    if isinstance(value, list):
        low, high = schema.get("minItems", 0), schema.get("maxItems", len(value))
        if not low <= len(value) <= high:
            return f"{where}: {len(value)} items"
        checked = (problem(schema["items"], inner, f"{where}[]") for inner in value)
        return next((found for found in checked if found), "")
    if isinstance(value, int | float) and not (
        schema.get("minimum", value) <= value <= schema.get("maximum", value)
    ):
        return f"{where}: {value} is out of range"
    return ""


def _of_object(schema: dict[str, Any], value: dict[str, Any], where: str) -> str:
    known = schema.get("properties", {})
    for name in schema.get("required", ()):
        if name not in value:
            return f"{where}.{name} is missing"
    for name, inner in value.items():
        if name not in known:
            return f"{where}.{name} is not in the schema"
        if found := problem(known[name], inner, f"{where}.{name}"):
            return found
    return ""
