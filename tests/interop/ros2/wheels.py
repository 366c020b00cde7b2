"""`python wheels.py COUNT SEED TYPE ...`: what ROS itself makes of messages; not with our Python.

It needs the wheels of Jazzy, which are for Python 3.12: rclpy, the classes of the messages, and the
library that serializes them. It imports nothing of this project.

Standard input has a line of JSON for each message of others, `[type, payload in hex]`. Standard
output has first the fields of each of these in the same order, or null for one that ROS cannot
read; then COUNT random messages of each TYPE, `[type, payload, fields]`. A service is a type with
the ending _Request or _Response.
"""

import array
import json
import random
import struct
import sys
from importlib import import_module
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractSequence,
    AbstractString,
    NamespacedType,
)

BITS = {"octet": 8, "uint8": 8, "int8": 7, "uint16": 16, "int16": 15, "uint32": 32, "int32": 31}
BITS |= {"uint64": 64, "int64": 63}
REALS = (0.0, -0.0, 1.0, -1.5, 1e-300, 1e300, float("inf"), float("-inf"), float("nan"))
TEXTS = ("", "a", "map", "base_link", "grün", "日本", "\U0001f916", "x" * 33)


def class_of(name: str) -> Any:
    """Return the class of a type."""
    package, kind, base = name.split("/")
    outer, _, part = base.partition("_")
    found = getattr(import_module(f"{package}.{kind}"), outer if part else base)
    return getattr(found, part) if part else found


def fields_of_class(kind: Any) -> list[tuple[str, Any]]:
    """Return name and type of each field."""
    return list(zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True))


def random_value(kind: Any, rng: random.Random) -> Any:
    """Return a random value of a type."""
    if isinstance(kind, AbstractNestedType):
        # Beyond the bound of a sequence, ROS writes what lies in memory.
        most = min(3, getattr(kind, "maximum_size", 3))
        size = rng.randint(0, most) if isinstance(kind, AbstractSequence) else kind.size
        values = [random_value(kind.value_type, rng) for _ in range(size)]
        return b"".join(values) if values and isinstance(values[0], bytes) else values
    if isinstance(kind, NamespacedType):
        return random_message(class_of("/".join(kind.namespaced_name())), rng)
    if isinstance(kind, AbstractString):
        return rng.choice(TEXTS)
    if kind.typename == "boolean":
        return rng.random() < 0.5
    if kind.typename in ("double", "float"):
        value = rng.choice(REALS) if rng.random() < 0.2 else rng.uniform(-1e3, 1e3)
        if kind.typename == "double":
            return value
        small = value if abs(value) < 1e30 or value in (float("inf"), float("-inf")) else 0.0
        return struct.unpack("<f", struct.pack("<f", small))[0]
    bits = BITS[kind.typename]
    lowest = -(1 << bits) if kind.typename.startswith("int") else 0
    value = rng.choice((lowest, (1 << bits) - 1, rng.randrange(lowest, 1 << bits)))
    return bytes([value]) if kind.typename == "octet" else value


def random_message(kind: Any, rng: random.Random) -> Any:
    """Return a message with random fields."""
    message = kind()
    for name, field in fields_of_class(kind):
        value = random_value(field, rng)
        if isinstance(value, bytes) and not isinstance(getattr(message, name), bytes):
            value = [bytes([one]) for one in value]
        setattr(message, name, value)
    return message


def plain(value: Any) -> Any:
    """Return a value as JSON has it: bytes are numbers, messages are objects."""
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (list, tuple, array.array)):
        return [plain(one) for one in value]
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    return value


def main() -> None:
    """Read what others have made, then write what ROS makes."""
    count, seed, *types = sys.argv[1:]
    for line in sys.stdin:
        name, data = json.loads(line)
        try:
            found = plain(deserialize_message(bytes.fromhex(data), class_of(name)))
        except Exception:
            found = None
        print(json.dumps(found))
    rng = random.Random(int(seed))
    for name in types:
        for _ in range(int(count)):
            message = random_message(class_of(name), rng)
            print(json.dumps([name, serialize_message(message).hex(), plain(message)]))


if __name__ == "__main__":
    main()
