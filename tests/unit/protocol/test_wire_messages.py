"""Messages: the fields of the XML, bytes equal to pymavlink's, enumerations, goals and topics."""

from enum import IntEnum
from math import inf, log, nan, pi, radians, sqrt
from types import ModuleType
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from protocol.dialect.definitions import read_dialect
from protocol.dialect.generate import CLASS_OF_ENUM, CONSTANTS, oracle
from protocol.outcome import (
    CHI2_2,
    OUTSIDE,
    doubt_m,
    doubt_words,
    rounded_heading_rad,
    start_arguments,
    wire_goal,
)
from protocol.topics import SERVICES, SONAR, TOPICS, Role, sender_of, system_id_of
from protocol.wire import enums
from protocol.wire.codec import CHECKSUM_SIZE, LARGEST_FRAME, Encoder, decode, is_frame
from protocol.wire.enums import Branch, GoalState, Mode, Navigator, Vehicle
from protocol.wire.message import LAYOUT, Message, check
from protocol.wire.messages import (
    MESSAGES,
    CycleReport,
    GroundTruth,
    LeaseRequest,
    LeaseStatus,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    RunScore,
    SonarScan,
    Statustext,
    WheelCommand,
)
from protocol.wire.reasons import Reason, reason_text
from robot.core import reasons, states
from robot.core.values import goal_of
from runtime.errors import LocalError, RemoteError, UserError
from tests.support.each import each
from tests.support.messages import (
    any_message,
    frame_by_pymavlink,
    messages_of,
    read_by_pymavlink,
    value_read,
    wire_values,
)

SCAN = SonarScan(time_ns=0, seq=0, range_mm=(0,) * 8, ping_age_us=(0,) * 8, valid=0, echo=0)


def test_there_is_a_class_for_every_layout() -> None:
    assert {cls.__name__ for cls in MESSAGES} == set(LAYOUT)


@each("cls", MESSAGES)
def test_fields_are_those_of_the_xml_in_its_order(cls: type[Message]) -> None:
    theirs = oracle().mavlink_map[LAYOUT[cls.__name__].number]
    assert list(cls.__struct_fields__) == theirs.fieldnames


def test_a_message_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        SCAN.seq = 1  # type: ignore[misc]


def test_fields_have_to_be_named() -> None:
    with pytest.raises(TypeError):
        SonarScan(0, 0, (0,) * 8, (0,) * 8, 0, 0)  # type: ignore[call-arg]


@each("length", [0, 7, 9])
def test_an_array_of_the_wrong_length_is_refused_when_made(length: int) -> None:
    with pytest.raises(LocalError, match=r"SonarScan\.range_mm = .*: must be 8 numbers"):
        SonarScan(time_ns=0, seq=0, range_mm=(0,) * length, ping_age_us=(0,) * 8, valid=0, echo=0)


def test_every_array_is_checked_when_made() -> None:
    zeros = dict.fromkeys(CycleReport.__struct_fields__, 0)
    with pytest.raises(LocalError, match="stage_us"):
        CycleReport(**{**zeros, "stage_us": (1, 2)})  # type: ignore[arg-type]
    zeros = dict.fromkeys(RunScore.__struct_fields__, 0)
    with pytest.raises(LocalError, match="digest"):
        RunScore(**{**zeros, "digest": (1,) * 31})  # type: ignore[arg-type]


@each(
    ("text", "limit"),
    [("x" * 51, "at most 50 bytes"), ("\xe9" * 26, "at most 50 bytes"), ("a\0b", "NUL")],
)
def test_a_text_that_does_not_fit_is_refused_when_made(text: str, limit: str) -> None:
    with pytest.raises(LocalError, match=limit):
        Statustext(severity=6, text=text)


def test_a_parameters_name_has_sixteen_bytes() -> None:
    sixteen = "p" * 16
    check(ParamSet(param_id=sixteen, param_value=1.0, param_type=9))
    for make in (
        lambda name: ParamSet(param_id=name, param_value=1.0, param_type=9),
        lambda name: ParamRequestRead(param_id=name, param_index=-1),
        lambda name: ParamValue(
            param_id=name, param_value=1.0, param_type=9, param_count=1, param_index=0
        ),
    ):
        with pytest.raises(LocalError, match=r"param_id = .*: must be at most 16 bytes"):
            make(sixteen + "q")


def test_names_in_a_lease_have_their_sizes() -> None:
    LeaseRequest(request_id=1, action=0, name="n" * 16)
    with pytest.raises(LocalError, match=r"name = .*: must be at most 16 bytes"):
        LeaseRequest(request_id=1, action=0, name="n" * 17)
    for holder, name in (("h" * 57, ""), ("", "n" * 17)):
        with pytest.raises(LocalError, match=r"must be at most"):
            LeaseStatus(time_ns=1, lapses_ms=0, held=1, holder=holder, name=name)


@each(
    ("change", "words"),
    [
        ({"severity": 256}, "severity = 256: must be an integer from 0 to 255"),
        ({"severity": "6"}, "severity = '6': must be an integer"),
        ({"text": "\ud800"}, "text = .*: must be valid Unicode"),
    ],
)
def test_check_names_what_construction_accepts(change: dict[str, Any], words: str) -> None:
    with pytest.raises(LocalError, match=words):
        check(Statustext(**{"severity": 6, "text": "", **change}))


def test_value_that_is_not_a_number_is_named() -> None:
    with pytest.raises(LocalError, match=r"param_value = None: must be a number"):
        check(ParamSet(param_id="p", param_value=None, param_type=9))  # type: ignore[arg-type]


def test_ranges_can_be_checked_without_a_wire() -> None:
    with pytest.raises(LocalError, match=r"SonarScan\.valid = 256: .* from 0 to 255"):
        check(SonarScan(**{**fields_of(SCAN), "valid": 256}))  # type: ignore[arg-type]


@given(any_message)
def test_every_wire_value_passes_the_check(message: Message) -> None:
    check(message)


def fields_of(message: Message) -> dict[str, object]:
    return {name: getattr(message, name) for name in message.__struct_fields__}


COMMAND = WheelCommand(
    time_ns=50_000_000, seq=1, sense_seq=1, left_mrad_s=-900, right_mrad_s=900, ttl_ms=150
)
octets = st.integers(0, 255)
FEW = settings().max_examples // 3
"""Of each of some fifty messages."""


def refused(frame: bytes) -> bool:
    try:
        decode(frame)
    except RemoteError:
        return True
    return False


@each("cls", MESSAGES)
def test_every_message_is_byte_identical_with_pymavlinks(cls: type[Message]) -> None:
    @settings(max_examples=FEW)
    @given(messages_of(cls), octets, octets)
    def story(message: Message, system: int, component: int) -> None:
        ours = Encoder(system, component).encode(message)
        assert ours == frame_by_pymavlink(message, system, component, 0)

    story()


@each("cls", MESSAGES)
def test_every_message_is_read_as_pymavlink_reads_it(cls: type[Message]) -> None:
    @settings(max_examples=FEW)
    @given(messages_of(cls))
    def story(message: Message) -> None:
        frame = Encoder(1, 1).encode(message)
        theirs = read_by_pymavlink(frame)
        ours = decode(frame).message
        for field in LAYOUT[cls.__name__].fields:
            assert repr(getattr(ours, field.name)) == repr(value_read(field, theirs))

    story()


@given(any_message, octets, octets)
def test_round_trip_preserves_nan_and_infinity(
    message: Message, system: int, component: int
) -> None:
    frame = decode(Encoder(system, component).encode(message))
    assert wire_values(frame.message) == wire_values(message)
    assert (frame.system_id, frame.component_id, frame.sequence) == (system, component, 0)


def test_the_sequence_counts_frames_and_wraps() -> None:
    encoder = Encoder(7, 1)
    seen = [decode(encoder.encode(COMMAND)).sequence for _ in range(300)]
    assert seen == [count % 256 for count in range(300)]


@given(st.binary(max_size=300))
@example(b"")
@example(b"\xfd")
@example(b"\xfe" * 20)
def test_random_bytes_raise_nothing_but_remote_error(noise: bytes) -> None:
    assert refused(noise)


@given(any_message, st.binary(min_size=1, max_size=255))
def test_valid_header_with_random_bytes_raises_remote_error(message: Message, noise: bytes) -> None:
    header = bytearray(Encoder(1, 1).encode(message)[:10])
    header[1] = len(noise)
    refused(bytes(header) + noise + b"\0\0")  # one in 65,536 has the right checksum by chance


def test_every_single_flipped_bit_is_refused() -> None:
    frame = Encoder(1, 1).encode(COMMAND)
    for bit in range(len(frame) * 8):
        broken = bytearray(frame)
        broken[bit // 8] ^= 1 << bit % 8
        assert refused(bytes(broken)), f"bit {bit}"


@given(any_message)
def test_every_truncation_is_refused(message: Message) -> None:
    frame = Encoder(1, 1).encode(message)
    assert all(refused(frame[:size]) for size in range(len(frame)))


def test_two_frames_in_one_sample_are_refused() -> None:
    assert refused(Encoder(1, 1).encode(COMMAND) * 2)


@each("text", ["", "a", "x" * 50])
@each("chunk_seq", [0, 255])
def test_zeros_at_the_end_are_left_out_and_read_back(text: str, chunk_seq: int) -> None:
    sent = Statustext(severity=6, text=text, id=65_535, chunk_seq=chunk_seq)
    frame = Encoder(1, 1).encode(sent)
    assert frame[-CHECKSUM_SIZE - 1] != 0
    assert decode(frame).message == sent


def test_frame_format_is_recognised_without_decoding() -> None:
    frame = Encoder(1, 1).encode(COMMAND)
    assert is_frame(frame)
    assert is_frame(frame[:-1] + bytes([frame[-1] ^ 1])), "the checksum is not looked at"
    for bad in (b"", frame[:-1], frame + b"\0", b"\xfe" + frame[1:], b"\xfd\0" + b"\0" * 10):
        assert not is_frame(bad)


def test_rejected_frame_gives_the_reason() -> None:
    frame = Encoder(1, 1).encode(COMMAND)
    causes = {
        b"": "too short",
        b"\xfe" + frame[1:]: "not with 0xfd",
        frame[:-1]: "announces",
        frame.ljust(LARGEST_FRAME + 1): f"longer than {LARGEST_FRAME} bytes",
        frame[:2] + b"\x01" + frame[3:]: "unsupported",
        frame[:7] + b"\xff\xff\xff" + frame[10:]: "16777215 is not in the dialect",
        frame[:-CHECKSUM_SIZE] + b"\0\0": "checksum of WHEEL_COMMAND",
    }
    for bad, words in causes.items():
        with pytest.raises(RemoteError, match=words):
            decode(bad)


def test_a_text_that_is_not_utf8_is_refused() -> None:
    text = Statustext(severity=6, text="caf\xe9")
    frame = frame_by_pymavlink(text, 1, 1, 0)
    assert decode(frame).message == text
    broken = Statustext(severity=6, text="AAAA")
    payload = Encoder(1, 1).encode(broken)[10:-2].replace(b"AAAA", b"\xff\xfe\xfd\xfc")
    with pytest.raises(RemoteError, match="not UTF-8"):
        decode(resealed(Encoder(1, 1).encode(broken), payload))


def test_known_part_of_a_longer_payload_is_read() -> None:
    frame = Encoder(1, 1).encode(COMMAND)
    payload = frame[10:-2].ljust(30, b"\0") + b"\x07\x08"
    longer = resealed(frame, payload)
    assert decode(longer).message == COMMAND
    assert read_by_pymavlink(longer).ttl_ms == 150


def resealed(frame: bytes, payload: bytes) -> bytes:
    """Return the frame with another payload and a correct checksum."""
    from fastcrc.crc16 import mcrf4xx

    number = int.from_bytes(frame[7:10], "little")
    crc_extra = next(x.crc_extra for x in LAYOUT.values() if x.number == number)
    body = bytes([len(payload)]) + frame[2:10] + payload
    return b"\xfd" + body + mcrf4xx(body + bytes([crc_extra])).to_bytes(2, "little")


@each(
    ("field", "value", "words"),
    [
        ("ttl_ms", 70_000, r"WheelCommand\.ttl_ms = 70000: .* from 0 to 65535"),
        ("ttl_ms", -1, r"WheelCommand\.ttl_ms = -1: .* from 0 to 65535"),
        ("left_mrad_s", 2**31, r"left_mrad_s = 2147483648: .* to 2147483647"),
        ("left_mrad_s", 1.5, r"left_mrad_s = 1\.5: must be an integer"),
        ("seq", None, r"seq = None: must be an integer"),
    ],
)
def test_our_own_bad_value_is_named_with_its_limit(field: str, value: int, words: str) -> None:
    fields = {f.name: getattr(COMMAND, f.name) for f in LAYOUT["WheelCommand"].fields}
    with pytest.raises(LocalError, match=words):
        Encoder(1, 1).encode(WheelCommand(**{**fields, field: value}))


def test_float_too_large_for_32_bits_is_a_local_error() -> None:
    fields: dict[str, Any] = {f.name: 0 for f in LAYOUT["GroundTruth"].fields}
    with pytest.raises(LocalError, match=r"GroundTruth\.x_m = 1e\+39"):
        Encoder(1, 1).encode(GroundTruth(**{**fields, "x_m": 1e39}))


def test_failed_frame_takes_no_sequence_number() -> None:
    encoder = Encoder(1, 1)
    with pytest.raises(LocalError):
        encoder.encode(Statustext(severity=999, text=""))
    assert decode(encoder.encode(COMMAND)).sequence == 0


def test_a_sender_outside_the_wires_range_is_refused() -> None:
    with pytest.raises(LocalError, match="system 256"):
        Encoder(256, 0)


DIALECT = read_dialect()
CORE_STATES = (Vehicle, Mode, GoalState, Navigator)


@each("name", DIALECT.enums)
def test_every_enum_of_the_dialect_has_its_members(name: str) -> None:
    members = {entry.name: entry.value for entry in DIALECT.enums[name].entries}
    if name in CONSTANTS:
        prefix = CONSTANTS[name]
        assert members == {key: getattr(enums, f"{prefix}_{key}") for key in members}
    else:
        cls = Reason if name == "SIDESTEP_REASON" else getattr(enums, CLASS_OF_ENUM[name])
        assert members == {member.name: member.value for member in cls}


@each("numbers", CORE_STATES)
def test_states_of_the_core_are_those_of_the_dialect(numbers: type[IntEnum]) -> None:
    assert all(getattr(states, member.name) == member.value for member in numbers)


def test_branches_of_the_core_are_those_of_the_dialect() -> None:
    names = ("TO_GOAL", "PASS_LEFT", "PASS_RIGHT", "ALIGN", "GIVE_UP", "LOST", "FAILED")
    core = {"NONE": states.NO_BRANCH} | {name: getattr(states, name) for name in names}
    assert core == {member.name: member.value for member in Branch}


def test_reasons_of_the_core_are_those_of_the_dialect() -> None:
    core = {{"OK": "NONE"}.get(name, name): n for name, n in constants(reasons).items()}
    assert core == {member.name: member.value for member in Reason}


def constants(module: ModuleType) -> dict[str, int]:
    return {name: n for name, n in vars(module).items() if name.isupper() and isinstance(n, int)}


def test_every_reason_has_words() -> None:
    words = {entry.value: entry.words for entry in DIALECT.enums["SIDESTEP_REASON"].entries}
    assert words == {reason.value: reason_text(reason) for reason in Reason}
    assert all(words.values())


def test_an_unknown_reason_is_shown_as_its_number() -> None:
    assert reason_text(255) == "reason 255"


metres = st.floats(-100.0, 100.0)
TOLERANCES = (0.05, 0.05235987755982989)


def test_a_goal_is_rounded_to_millimetres_and_microradians() -> None:
    assert wire_goal(5.4, -0.0204, pi / 2, *TOLERANCES) == (5400, -20, 1_570_796, 0, 50, 52360)


def test_any_heading_is_a_flag_and_not_an_angle() -> None:
    goal = wire_goal(1.0, 0.0, None, *TOLERANCES)
    assert (goal.heading_free, goal.heading_urad) == (1, 0)
    assert goal_of(*goal).heading_rad is None


@each("place", range(5))
@each("bad", [nan, inf, -inf])
def test_non_finite_goal_is_rejected(bad: float, place: int) -> None:
    values = [1.0, 2.0, 0.0, *TOLERANCES]
    values[place] = bad
    with pytest.raises(ValueError, match="finite"):
        wire_goal(*values)


@given(metres, metres, st.floats(-2 * pi, 2 * pi))
def test_the_core_gets_the_goal_within_half_a_millimetre(
    x_m: float, y_m: float, heading_rad: float
) -> None:
    goal = goal_of(*wire_goal(x_m, y_m, heading_rad, *TOLERANCES))
    assert goal.heading_rad is not None
    assert abs(goal.x_m - x_m) <= 0.000_501
    assert abs(goal.y_m - y_m) <= 0.000_501
    assert abs(goal.heading_rad - heading_rad) <= 0.51e-6


@given(metres, metres, st.integers(-360_000, 360_000))
def test_start_given_as_text_arrives_bit_identical(x: float, y: float, mdeg: int) -> None:
    heading_rad = radians(mdeg / 1000)
    words = start_arguments(x, y, heading_rad)
    assert (float(words[0]), float(words[1])) == (x, y)
    assert radians(float(words[2])) == rounded_heading_rad(heading_rad) == heading_rad


def test_no_path_is_used_twice() -> None:
    paths = [topic.path for topic in TOPICS] + [service.path for service in SERVICES]
    assert len(paths) == len(set(paths))


def test_periodic_stream_stays_fresh_after_two_lost_frames() -> None:
    streams = [topic for topic in TOPICS if topic.stale_after_ns and topic.rate_hz]
    assert streams
    for topic in streams:
        assert topic.stale_after_ns >= 2.9e9 / topic.rate_hz, topic.path


def test_every_topic_has_messages_and_a_description() -> None:
    assert all(topic.messages and topic.doc for topic in TOPICS)
    assert all(service.doc for service in SERVICES)


def test_a_key_has_prefix_robot_and_path() -> None:
    assert SONAR.key("r1") == "sidestep/r1/sense/sonar"
    assert SONAR.key("r1", prefix="test-7") == "test-7/r1/sense/sonar"
    assert SERVICES[0].key("r_2-b") == "sidestep/r_2-b/srv/command"


@each("name", ["", "R1", "a/b", "r*", "x" * 17, "r 1", "r1\n", "é"])
def test_a_name_that_could_break_a_key_is_refused_with_the_rule(name: str) -> None:
    with pytest.raises(UserError, match="1 to 16 of the characters"):
        SONAR.key(name)


@given(st.from_regex(r"[a-z0-9_-]{1,16}", fullmatch=True))
def test_every_good_name_is_one_element_of_a_key(name: str) -> None:
    assert SONAR.key(name).split("/") == ["sidestep", name, "sense", "sonar"]
    assert 1 <= system_id_of(name) <= 250


def test_senders_are_distinguishable() -> None:
    assert sender_of(Role.ROBOT, "r7") == (7, 1)
    assert sender_of(Role.PLANT, "r7") == (7, 25)
    assert sender_of(Role.GROUND, "r7") == (255, 190)
    assert sender_of(None, "r7") == (254, 0)
    assert [system_id_of(name) for name in ("r", "r0", "r250", "r251", "r999")] == [1, 1, 250, 1, 1]


def test_constant_is_the_quantile_of_the_study() -> None:
    assert pytest.approx(-2.0 * log(OUTSIDE), rel=1e-12) == CHI2_2


@each("axes", [(0.04, 0.01), (0.01, 0.04)])
def test_doubt_is_the_longer_axis(axes: tuple[float, float]) -> None:
    assert doubt_m(axes[0], 0.0, axes[1]) == pytest.approx(0.2 * sqrt(CHI2_2))


def test_correlation_makes_the_ellipse_longer() -> None:
    assert doubt_m(0.01, 0.01, 0.01) == pytest.approx(sqrt(0.02 * CHI2_2))


@each("value", [nan, inf, -1.0])
def test_no_covariance_gives_no_doubt(value: float) -> None:
    assert doubt_m(value, 0.0, value) is None


def test_words_show_centimetres_or_unknown() -> None:
    assert doubt_words(0.4249) == "position doubt 0.42 m"
    assert doubt_words(None) == "position doubt unknown"
