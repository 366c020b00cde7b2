"""Messages of this gateway, judged by the wheels of ROS 2 Jazzy, and theirs by this gateway."""

from collections import Counter
from random import Random

import pytest

from checks.built import BuildError
from gateways.ros2.interfaces import Interfaces
from gateways.ros2.wire import Distro
from tests.support.gateway.ros_messages import (
    TYPES,
    as_text,
    fields_of,
    random_message,
    read_by_wheels,
)

pytestmark = pytest.mark.interop
MESSAGES = 1000
JAZZY = Interfaces(Distro.JAZZY)


def test_ros_reads_each_message_and_each_of_its_is_read(seed: int) -> None:
    rng = Random(seed)
    own = [(name, random_message(JAZZY, name, rng)) for name in TYPES for _ in range(MESSAGES)]
    sent = [(name, JAZZY.encode(name, message)) for name, message in own]
    try:
        found, made = read_by_wheels(sent, MESSAGES, seed)
    except BuildError as error:
        pytest.skip(f"the wheels of ROS are not installed: {error}")
    equal: Counter[str] = Counter()
    for (name, message), fields in zip(own, found, strict=True):
        equal[f"{name} read by ROS"] += as_text(fields) == as_text(fields_of(JAZZY, name, message))
    for name, data, fields in made:
        message = JAZZY.decode(name, data)
        is_equal = message is not None and as_text(fields_of(JAZZY, name, message)) == as_text(
            fields
        )
        equal[f"{name} of ROS"] += is_equal
    expected = {f"{name} {way}": MESSAGES for name in TYPES for way in ("read by ROS", "of ROS")}
    assert dict(equal) == expected
