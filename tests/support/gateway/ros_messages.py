"""Random messages of ROS 2, and their fields as JSON has them, from the definitions in use here.

`python -m tests.support.gateway.ros_messages` writes the committed messages of the ROS wheels.
"""

import gzip
import json
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any, Final, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype

from checks.built import environment
from gateways.ros2.interfaces import SERVICES, Interfaces

WHEELS: Final = Path(__file__).parents[2] / "interop" / "ros2"
KEPT: Final = Path(__file__).parents[2] / "data" / "ros2" / "wheel_messages.jsonl.gz"
"""Messages that the ROS wheels have made, for tests without them."""

KEPT_OF_EACH: Final = 12
NO_FIELD: Final = "structure_needs_at_least_one_member"
TOPICS: Final = (
    *("nav_msgs/msg/Odometry", "sensor_msgs/msg/Range", "sensor_msgs/msg/LaserScan"),
    *("sensor_msgs/msg/JointState", "std_msgs/msg/String", "rosgraph_msgs/msg/Clock"),
    *("diagnostic_msgs/msg/DiagnosticArray", "rcl_interfaces/msg/Log", "nav_msgs/msg/Path"),
    *("visualization_msgs/msg/MarkerArray", "rcl_interfaces/msg/ParameterEvent"),
    *("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"),
    *("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"),
    *("geometry_msgs/msg/TransformStamped", "action_msgs/msg/GoalStatusArray"),
)
"""The topics of a robot that the wheels have; of tf2_msgs/TFMessage what it is a sequence of."""

TYPES: Final = (
    *TOPICS,
    *(f"{name}_{part}" for name in SERVICES for part in ("Request", "Response")),
)
REALS: Final = (0.0, -0.0, 1e-30, -1.5, float("inf"), float("-inf"), float("nan"))
TEXTS: Final = ("", "a", "odom", "Straße", "日本", "\U0001f916", "y" * 70)


class RosMessage(NamedTuple):
    """A message of a type: its bytes, and its fields."""

    type_name: str
    data: bytes
    fields: Any


def random_message(interfaces: Interfaces, name: str, rng: Random) -> Any:
    """Return a message with random fields."""
    _, fields = interfaces._store.fielddefs[name]
    return interfaces.make(name, *(_random(interfaces, one, rng) for _, one in fields))


def _random(interfaces: Interfaces, definition: Any, rng: Random) -> Any:
    kind, what = definition
    if kind is Nodetype.NAME:
        return random_message(interfaces, what, rng)
    if kind is Nodetype.BASE:
        return _random_base(what[0], rng)
    element, size = what
    count = size if kind is Nodetype.ARRAY else rng.randrange(4)
    values = [_random(interfaces, element, rng) for _ in range(count)]
    if element[0] is Nodetype.BASE and element[1][0] != "string":
        base = "int8" if element[1][0] == "byte" else element[1][0]
        return np.array(values, base)
    return values


def _random_base(base: str, rng: Random) -> Any:
    if base == "string":
        return rng.choice(TEXTS)
    if base == "bool":
        return rng.random() < 0.5
    if base.startswith("float"):
        value = rng.choice(REALS) if rng.random() < 0.2 else rng.gauss(0.0, 1e3)
        return float(np.dtype(base).type(value))
    limits = np.iinfo("int8" if base == "byte" else base)
    lowest, highest = int(limits.min), int(limits.max)
    return rng.choice((lowest, highest, rng.randint(lowest, highest)))


def fields_of(interfaces: Interfaces, name: str, message: Any) -> dict[str, Any]:
    """Return the fields as JSON has them; a message without any has none."""
    _, fields = interfaces._store.fielddefs[name]
    return {
        field: _plain(interfaces, definition, getattr(message, field))
        for field, definition in fields
        if field != NO_FIELD
    }


def _plain(interfaces: Interfaces, definition: Any, value: Any) -> Any:
    kind, what = definition
    if kind is Nodetype.NAME:
        return fields_of(interfaces, what, value)
    if kind is Nodetype.BASE:
        return value & 255 if what[0] == "byte" else value  # the library reads it as signed
    return [_plain(interfaces, what[0], one) for one in getattr(value, "tolist", lambda: value)()]


def as_text(fields: Any) -> str:
    """Return fields as a text that is equal for equal fields, also for those that are nan."""
    return json.dumps(fields, sort_keys=True)


def read_by_wheels(
    own: Iterable[tuple[str, bytes]], count: int, seed: int, types: Sequence[str] = TYPES
) -> tuple[list[Any], Iterator[RosMessage]]:
    """Return the fields that ROS reads in messages, and random messages that it makes.

    Raises BuildError without the wheels, or the Python that they are for.
    """
    pins = [line for line in (WHEELS / "pins.txt").read_text("utf-8").split() if "==" in line]
    python = environment("ros2-jazzy", pins, "python3.12")
    asked = [json.dumps([name, data.hex()]) for name, data in own]
    found = subprocess.run(
        [str(python), str(WHEELS / "wheels.py"), str(count), str(seed), *types],
        input="\n".join(asked),
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == 0, found.stderr[-2000:]
    lines = found.stdout.splitlines()
    return list(map(json.loads, lines[: len(asked)])), map(_message, lines[len(asked) :])


def _message(line: str) -> RosMessage:
    name, data, fields = json.loads(line)
    return RosMessage(name, bytes.fromhex(data), fields)


def kept() -> list[RosMessage]:
    """Return the committed messages of the wheels."""
    return list(map(_message, gzip.decompress(KEPT.read_bytes()).decode().splitlines()))


def main() -> None:
    """Write the committed messages again."""
    _, made = read_by_wheels([], KEPT_OF_EACH, 1)
    lines = (json.dumps([one.type_name, one.data.hex(), one.fields]) for one in made)
    KEPT.write_bytes(gzip.compress("\n".join(lines).encode(), mtime=0))


if __name__ == "__main__":
    main()
