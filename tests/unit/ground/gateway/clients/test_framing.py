from random import Random

from gateways.mavlink.clients import ClientLink, NoFile
from gateways.mavlink.framing import (
    MAX_WAITING,
    UNFINISHED_NS,
    Deframer,
    MavFrame,
    is_emergency_stop,
)
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.signing import SigningGuard
from runtime.units import NS_PER_S
from tests.support.each import each

HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def packed(message: object = HEARTBEAT, *, mavlink1: bool = False, sequence: int = 0) -> bytes:
    encoder = mavlink.MAVLink(NoFile(), 255, 190)
    encoder.seq = sequence
    found: bytes = message.pack(encoder, force_mavlink1=mavlink1)  # type: ignore[attr-defined]
    return found


def taken(deframer: Deframer, data: bytes, now_ns: int = 0) -> list[MavFrame]:
    deframer.allowance = 100_000
    deframer.feed(data)
    return deframer.take(now_ns)


def test_both_versions_pass_whole_and_in_pieces() -> None:
    data = packed() + packed(mavlink1=True, sequence=7)
    whole = taken(Deframer(), data)
    deframer = Deframer()
    pieces = [frame for byte in data for frame in taken(deframer, bytes((byte,)))]
    assert whole == pieces
    assert [(one.sequence, one.is_mavlink1) for one in whole] == [(0, False), (7, True)]
    assert whole[0][2:] == (0, 255, 190, False)


def test_frame_after_rubbish_is_found() -> None:
    good = packed()
    for rubbish in (b"\xfd", b"\xfe\xff", b"hello", good[:9], good[:-1] + b"!", b"\xfd" * 300):
        deframer = Deframer()
        found = taken(deframer, rubbish + good * 20)
        assert len(found) >= 18, rubbish
        assert deframer.malformed or rubbish == b"hello"


STOP = mavlink.MAVLink_command_long_message(1, 1, 185, 0, 1.0, 0, 0, 0, 0, 0, 0)
STUCK = b"\xfd\xff\x00\x00\x00\xff\xbe\x00\x00\x00"
"""The header of a frame of 267 bytes."""


@each(
    "false",
    [
        b"\xfd\xff\x02",
        b"\xfd\xff\x40\x00",
        b"\xfe\xff" + bytes(4),
        b"\xfe\xff" + bytes(4),
    ],
)
def test_start_that_no_frame_can_have_delays_nothing(false: bytes) -> None:
    assert len(taken(Deframer(), false + packed())) == 1


@each(
    ("before", "behind"),
    [
        (STUCK, b""),
        (STUCK, STUCK),
        (STUCK[:4], b""),
        (b"\xfd", b""),
        (b"\xfe\x09\x00\x00\x00\x00", b""),
    ],
)
def test_emergency_stop_behind_an_unfinished_frame_is_found_at_once(
    before: bytes, behind: bytes
) -> None:
    for mavlink1 in (False, True):
        stop = packed(STOP, mavlink1=mavlink1)
        whole, pieces = Deframer(), Deframer()
        assert [one.data for one in taken(whole, before + stop + behind)] == [stop]
        found = [one for byte in before + stop for one in taken(pieces, bytes((byte,)))]
        assert [one.data for one in found] == [stop]
        assert taken(whole, b"", UNFINISHED_NS) == [], "it was taken twice"


def test_frames_carried_by_another_one_are_no_commands_but_for_a_stop() -> None:
    """An uploaded log may hold any: the outer frame arrives in pieces."""
    arm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0)
    clear = mavlink.MAVLink_command_long_message(1, 1, 185, 0, 0.0, 0, 0, 0, 0, 0, 0)
    for carried in ([arm, clear], [STOP, clear], [STOP, arm]):
        inner = b"".join(map(packed, carried)).ljust(128, b"!")
        outer = packed(mavlink.MAVLink_tunnel_message(1, 1, 0, len(inner), inner))
        for cut in range(1, len(outer)):
            deframer = Deframer()
            found = [*taken(deframer, outer[:cut]), *taken(deframer, outer[cut:])]
            stops = [one for one in found if is_emergency_stop(one)]
            assert [one.data for one in found if one not in stops] == [outer], cut
            assert len(stops) <= (STOP in carried)


def test_no_frame_between_a_false_start_and_a_stop_is_lost() -> None:
    other = packed(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0.0, 0, 0, 0, 0, 0, 0))
    deframer = Deframer()
    data = STUCK + other + packed(STOP) + packed()
    assert [one.data for one in taken(deframer, data)] == [packed(STOP)]
    later = taken(deframer, b"", UNFINISHED_NS)
    assert [one.data for one in later] == [other, packed()]


def test_decoys_do_not_hold_up_the_search_for_a_stop() -> None:
    deframer, decoy = Deframer(), b"\xfe\x00\x00\x00\x00\x4c"
    for byte in (b"\x4a", b"\x4b", b"\x4c", b"\x4d"):
        hidden = b"\xfe" + packed(STOP, sequence=byte[0])
        assert len(taken(Deframer(), STUCK + hidden)) == 1, byte
    deframer.feed(STUCK + decoy * 20 + packed(STOP))
    found: list[MavFrame] = []
    for _ in range(4):
        deframer.allowance = 8
        found += deframer.take(0)
    assert len(found) == 1


def test_length_that_never_completes_costs_half_a_second() -> None:
    deframer, stuck = Deframer(), STUCK
    assert taken(deframer, stuck + packed()) == []
    assert taken(deframer, packed(), UNFINISHED_NS - 1) == []
    assert len(taken(deframer, packed(), UNFINISHED_NS)) == 3


def test_unknown_message_is_skipped_as_a_whole() -> None:
    deframer, unknown = Deframer(), bytearray(packed())
    unknown[7:10] = b"\xff\xff\x7f"
    assert len(taken(deframer, bytes(unknown) + packed())) == 1
    assert deframer.unknown == 1


def test_flag_that_changes_the_format_is_refused() -> None:
    odd = bytearray(packed())
    odd[2] = 0x02
    assert taken(Deframer(), bytes(odd)) == []


def test_allowance_bounds_the_work_and_the_memory() -> None:
    deframer = Deframer()
    deframer.feed(b"\xfd\x00\x00" * 100_000)
    deframer.allowance = 50
    assert deframer.take(0) == []
    assert deframer.allowance == 0
    assert len(deframer._waiting) <= MAX_WAITING
    assert deframer.dropped == 300_000 - MAX_WAITING


def test_random_bytes_and_damaged_frames_never_raise() -> None:
    random, link, data = Random(5), ClientLink(1, "peer", 0), packed()
    for turn in range(3_000):
        damaged = bytearray(data)
        damaged[random.randrange(len(damaged))] = random.randrange(256)
        rubbish = random.randbytes(random.randrange(40))
        link.allow(100)
        link.feed(bytes(damaged) + rubbish)
        for frame in link.frames(turn * NS_PER_S // 100):
            link.decode(frame)
    assert link.malformed > 1_000


def test_lost_frames_are_counted_per_sender() -> None:
    link = ClientLink(1, "peer", 0)
    link.allow(10)
    link.feed(packed(sequence=254) + packed(sequence=255) + packed(sequence=2))
    assert len(link.frames(0)) == 3
    assert (link.received, link.lost) == (3, 2)


def test_frame_that_was_overtaken_is_not_lost() -> None:
    link = ClientLink(1, "peer", 0)
    link.allow(10)
    for sequence in (254, 0, 255, 1, 2):
        link.feed(packed(sequence=sequence))
    assert len(link.frames(0)) == 5
    assert (link.received, link.lost) == (5, 0)


def test_line_is_lossy_while_frames_are_missing() -> None:
    link = ClientLink(1, "peer", 0)

    def hear(*sequences: int) -> bool:
        link.allow(len(sequences))
        link.feed(b"".join(packed(sequence=one % 256) for one in sequences))
        link.frames(0)
        return link.is_lossy

    assert not hear(*range(20))
    assert hear(*(one for one in range(20, 40) if one % 5))
    assert not hear(*range(40, 140))


def test_answers_are_in_the_version_of_the_client() -> None:
    link = ClientLink(1, "peer", 0)
    link.allow(10)
    link.feed(packed(mavlink1=True))
    message = link.decode(link.frames(0)[0])
    assert message is not None
    assert message.type == 6
    assert link.encode(1, HEARTBEAT, SigningGuard(lambda: 0))[0] == mavlink.PROTOCOL_MARKER_V1


@each("mavlink1", [False, True])
def test_each_vehicle_has_one_sequence_without_gaps(mavlink1: bool) -> None:
    link, guard = ClientLink(1, "peer", 0), SigningGuard(lambda: 0)
    link.is_mavlink1 = mavlink1
    kinds = (HEARTBEAT, mavlink.MAVLink_wheel_distance_message(0, 0, [0.0] * 16))
    frames = [link.encode(1 + at % 2, kinds[at % 3 == 0], guard) for at in range(1200)]
    found = mavlink.MAVLink(NoFile()).parse_buffer(b"".join(frames))
    for system in (1, 2):
        mine = [one for one in found if one.get_srcSystem() == system]
        assert [one.get_seq() for one in mine] == [at % 256 for at in range(len(mine))]
        assert {one.get_srcComponent() for one in mine} == {mavlink.MAV_COMP_ID_AUTOPILOT1}
    assert len(found) == (800 if mavlink1 else 1200)
