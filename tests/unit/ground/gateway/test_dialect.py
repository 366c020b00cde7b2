from pymavlink.dialects.v20 import common, development

from gateways.mavlink.mavlink_dialect import (
    AvailableModes,
    ComponentMetadata,
    ControlStatus,
    CurrentMode,
    MavMessage,
    MissionAck,
    MissionCount,
    MissionCurrent,
    mavlink,
)
from tests.support.each import each

MESSAGES = [
    ComponentMetadata(time_boot_ms=7, file_crc=0xDEADBEEF, uri=b"mftp:///general.json.xz"),
    AvailableModes(3, 1, 4, 15, 2, b"GUIDED"),
    CurrentMode(0, 10, 10),
    ControlStatus(3, 255, [1, 2, 0, 0, 0, 0, 0, 0, 0, 9]),
    *(
        MISSION_MESSAGES := [
            MissionCurrent(3, 7, 3, 1, 0xDEADBEEF, 0xFFFFFFFF, 1),
            MissionCount(1, 1, 200, 1, 0xDEADBEEF),
            MissionAck(255, 190, 15, 2, 0xDEADBEEF),
        ]
    ),
]


class Sink:
    def write(self, data: bytes) -> None:
        """Ignore the bytes."""


@each("message", MESSAGES)
def test_own_messages_survive_encoding_and_decoding(message: MavMessage) -> None:
    encoder = mavlink.MAVLink(Sink(), 1, 1)
    (found,) = encoder.parse_buffer(message.pack(encoder))
    assert found.to_dict() == message.to_dict()


@each("message", MESSAGES[1:3])
def test_own_layouts_are_those_of_the_development_dialect(message: MavMessage) -> None:
    theirs = development.mavlink_map[message.id]
    for fact in ("crc_extra", "ordered_fieldnames", "orders", "lengths", "array_lengths"):
        assert getattr(message, fact) == getattr(theirs, fact)
    assert message.unpacker.format == theirs.unpacker.format


@each("message", MISSION_MESSAGES)
def test_plan_ids_extend_the_messages_of_the_dialect(message: MavMessage) -> None:
    theirs = common.mavlink_map[message.id]
    assert message.crc_extra == theirs.crc_extra
    assert message.ordered_fieldnames[: len(theirs.ordered_fieldnames)] == theirs.ordered_fieldnames
    assert message.unpacker.format.startswith(theirs.unpacker.format)
