"""Rows 1, 3-6, 9, 10, 70: heartbeat, addresses, sequences, several clients, versions."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

from runtime.units import NS_PER_S
from vehicle_check.ground_stations import (
    Elapsed,
    GroundStation,
    ReceivedMessage,
    result_name,
)
from vehicle_check.mavlink_frames import mavlink
from vehicle_check.vehicle_under_test import (
    ARDUPILOTS,
    ONE_CLIENT,
    ROVER,
    Findings,
    RowStatus,
    RowVerdict,
    VehicleCheck,
    VehicleProfile,
    failed,
    is_vehicle,
    not_applicable,
    not_tried,
    passed,
    row,
)

HOLD: Final = mavlink.ROVER_MODE_HOLD
GUIDED: Final = mavlink.ROVER_MODE_GUIDED
MANUAL: Final = mavlink.ROVER_MODE_MANUAL
ROVER_MODES: Final = frozenset(
    number
    for number, entry in mavlink.enums["ROVER_MODE"].items()
    if not entry.name.endswith("_ENUM_END")
)
AT_ONCE_S: Final = 0.4
DROPPED_AFTER_S: Final = (9.0, 12.0)
OTHER_SYSTEM: Final = 37
OFFICIAL: Final = mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL
RELEASE_TYPES: Final = frozenset(
    number
    for number, entry in mavlink.enums["FIRMWARE_VERSION_TYPE"].items()
    if not entry.name.endswith("_ENUM_END")
)
REQUIRED_CAPABILITIES: Final = (
    "MISSION_FLOAT", "PARAM_FLOAT", "MISSION_INT", "COMMAND_INT", "FTP",
    "SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "FLIGHT_TERMINATION",
    "MAVLINK2", "MISSION_FENCE", "PARAM_ENCODE_C_CAST",
)  # fmt: skip
CANCEL_CALIBRATION: Final = mavlink.MAV_CMD_DO_CANCEL_MAG_CAL


def capability(name: str) -> int:
    """Return the bit of a capability."""
    return int(getattr(mavlink, f"MAV_PROTOCOL_CAPABILITY_{name}"))


@row(
    1,
    "HEARTBEAT: component 1, type and autopilot of the profile, custom mode, 1 Hz and on change",
    suffers="every client: no vehicle, or a mode that changes late",
    source="MAVLink guide, heartbeat; ArduPilot Rover/GCS_MAVLink_Rover.cpp",
)
def heartbeat(check: VehicleCheck) -> RowVerdict:
    """Judge the fields and the rate; change the mode of a disarmed vehicle."""
    found = Findings()
    _expect_rate(check, found)
    one = check.heartbeat
    found.expect(check.station.target_component == 1, f"comp {check.station.target_component}")
    is_type = one.type == mavlink.MAV_TYPE_GROUND_ROVER or not check.is_rover
    found.expect(is_type, f"type {one.type}")
    profile = check.options.profile
    hint = "" if profile is profile_of(one) else f": judge it with --as {profile_of(one)}"
    wanted = AUTOPILOTS.get(profile, one.autopilot)
    found.expect(one.autopilot == wanted, f"autopilot {one.autopilot}{hint}")
    if profile is not VehicleProfile.GENERIC:
        is_custom = one.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        found.expect(is_custom, f"base_mode 0x{one.base_mode:02x}")
    if check.is_rover and not check.is_armed:
        _expect_change(check, found)
    return found.verdict()


AUTOPILOTS: Final = {
    VehicleProfile.ROVER: mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    VehicleProfile.ARDUPILOT: mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    VehicleProfile.PX4: mavlink.MAV_AUTOPILOT_PX4,
}


def profile_of(one: Any) -> VehicleProfile:
    """Return the profile of a heartbeat."""
    if one.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        is_rover = one.type == mavlink.MAV_TYPE_GROUND_ROVER
        return VehicleProfile.ROVER if is_rover else VehicleProfile.ARDUPILOT
    is_px4 = one.autopilot == mavlink.MAV_AUTOPILOT_PX4
    return VehicleProfile.PX4 if is_px4 else VehicleProfile.GENERIC


def _expect_rate(check: VehicleCheck, found: Findings) -> None:
    beats = [one for one in check.seen("HEARTBEAT") if is_vehicle(one.message)]
    if not found.expect(
        len(beats) >= 2, f"{len(beats)} HEARTBEATs in {check.window.seconds:.0f} s"
    ):
        return
    contents = [
        (one.message.custom_mode, one.message.base_mode, one.message.system_status) for one in beats
    ]
    seconds = (beats[-1].at_ns - beats[0].at_ns) / NS_PER_S
    # A heartbeat that is sent at once after a change may be in addition to the regular ones.
    changes = sum(one != other for one, other in pairwise(contents))
    all_hz, regular_hz = ((len(beats) - 1 - more) / seconds for more in (0, changes))
    is_right = all_hz >= 0.85 and regular_hz <= 1.3
    found.expect(is_right, f"HEARTBEAT {all_hz:.2f} Hz, {changes} changes")


def _expect_change(check: VehicleCheck, found: Findings) -> None:
    before, since = check.mode, check.main.mark()
    # Without a position a vehicle may refuse GUIDED, but not MANUAL.
    for other in (GUIDED, MANUAL) if before == HOLD else (HOLD,):
        result = check.set_mode(other)
        if result == mavlink.MAV_RESULT_ACCEPTED:
            break
    else:
        found.expect(False, f"mode {other}: {result_name(result)} {check.texts(since)}")
        return
    stopwatch = check.station.stopwatch()
    start_ns = check.main.sent("COMMAND_ACK", since, _accepted)[0].at_ns
    beat = check.main.expect_sent("HEARTBEAT", 1.5, lambda one: one.custom_mode == other, since)
    late_s = 9.9 if beat is None else (beat.at_ns - start_ns) / NS_PER_S
    late = Elapsed(late_s, min(late_s, stopwatch.elapsed.held_up_s))
    found.expect_in_time(late, AT_ONCE_S, f"HEARTBEAT mode {other} {late_s:.2f} s after the ACK")
    check.set_mode(before)
    check.main.expect_sent("HEARTBEAT", 1.5, lambda one: one.custom_mode == before)


def _accepted(ack: Any) -> bool:
    return bool(ack.result == mavlink.MAV_RESULT_ACCEPTED)


@row(
    3,
    "heartbeats of other components have a mode of Rover, or type GCS",
    suffers="DroneKit: exception on an unknown mode",
    source="DroneKit dronekit/__init__.py",
    profiles=ROVER,
)
def other_components(check: VehicleCheck) -> RowVerdict:
    """Judge the heartbeats of all components but the autopilot."""
    others = {
        one.component: one.message
        for one in check.window.frames
        if one.name == "HEARTBEAT" and one.component != check.station.target_component
    }
    wrong = [
        f"comp {component}: type {one.type} custom_mode {one.custom_mode}"
        for component, one in others.items()
        if one.type != mavlink.MAV_TYPE_GCS and one.custom_mode not in ROVER_MODES
    ]
    return failed("; ".join(wrong)) if wrong else passed(f"{len(others)} other components")


@row(
    4,
    "targets: system 0 and its own accepted, component 0 and 1, other systems ignored",
    suffers="DroneKit: simple_goto and parameters send target 0",
    source="MAVLink guide, routing; DroneKit",
)
def targets(check: VehicleCheck) -> RowVerdict:
    """Ask for a parameter with several targets, and send a command to another system."""
    found = Findings()
    for target in ((0, 0), (check.target, 0), (check.target, 1)):
        read = mavlink.MAVLink_param_request_read_message(*target, b"", 0)
        answer = check.main.ask(read, "PARAM_VALUE", within_s=0.6)
        found.expect(answer, f"PARAM_REQUEST_READ to {target}: {'' if answer else 'no '}answer")
    since = check.main.mark()
    number = mavlink.MAV_CMD_REQUEST_MESSAGE
    other = (check.target + OTHER_SYSTEM) % 250 + 1
    check.main.send_surely(mavlink.MAVLink_command_long_message(other, 1, number, 0, 148, *[0] * 6))
    check.station.wait(0.4)
    is_quiet = not check.main.sent("COMMAND_ACK", since, lambda ack: ack.command == number)
    found.expect(is_quiet, f"command for system {other}: {'no ' if is_quiet else ''}ACK")
    return found.verdict()


@row(
    5,
    "one sequence without gaps for each system and component",
    suffers="QGroundControl: shows lost frames",
    source="MAVLink guide, serialization; QGroundControl src/Vehicle/Vehicle.cc",
)
def sequences(check: VehicleCheck) -> RowVerdict:
    """Count gaps, also of frames that the judge has dropped itself."""
    frames = check.window.frames
    gaps = gaps_in(frames)
    sources = sorted({(one.system, one.component) for one in frames})
    return (failed if gaps else passed)(f"{gaps} gaps in {len(frames)} frames of {sources}")


def gaps_in(frames: Sequence[ReceivedMessage]) -> int:
    """Return how often a sequence number does not follow that before."""
    last: dict[tuple[int, int], int] = {}
    gaps = 0
    for one in frames:
        source = one.system, one.component
        gaps += source in last and (one.sequence - last[source]) % 256 != 1
        last[source] = one.sequence
    return gaps


@row(
    6,
    "clients at any UDP port, 5 at once, dropped after 10 s of silence",
    suffers="Mission Planner, QGroundControl and MAVProxy side by side",
    source="QGroundControl, Mission Planner, MAVProxy side by side",
)
def several_clients(check: VehicleCheck) -> RowVerdict:
    """Count the frames of four more clients, and when those for a silent client end."""
    if check.station.network.is_shared:
        return not_applicable(ONE_CLIENT)
    found = Findings()
    window = check.window
    # Other streams may go only to those that ask for them.
    counts = [len(one.sent("HEARTBEAT")) for one in window.watchers]
    if check.station.network.is_stream and not any(counts):
        return not_applicable("this TCP endpoint serves one connection")
    own = len(check.seen("HEARTBEAT"))
    found.expect(min(counts) >= own // 2, f"heartbeats for 5 clients: {own}, {counts}")
    if check.station.network.is_stream:
        found.fact("a silent TCP connection ends by closing")
        return found.verdict()
    silent = window.silent.log
    last_s = (silent[-1].at_ns - window.began_ns) / NS_PER_S if silent else 0.0
    low_s, high_s = DROPPED_AFTER_S
    found.expect(low_s <= last_s <= high_s, f"silent client: last frame after {last_s:.1f} s")
    return found.verdict()


def versions(
    check: VehicleCheck, client: GroundStation, ways: Sequence[str] | None = None
) -> dict[str, Any]:
    """Ask for AUTOPILOT_VERSION in the three ways of clients, or in some of them."""
    target = check.station.address
    name = "AUTOPILOT_VERSION"
    asked = {
        "512/148": client.command_long(mavlink.MAV_CMD_REQUEST_MESSAGE, 148),
        "520": client.command_long(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1),
        "message 183": mavlink.MAVLink_autopilot_version_request_message(*target),
    }
    return {
        way: client.ask(message, name)
        for way, message in asked.items()
        if ways is None or way in ways
    }


@row(
    9,
    "AUTOPILOT_VERSION by 512, 520 and 183; its bits tell what is there",
    suffers="Mission Planner sends all three; MAVSDK, QGroundControl, DroneKit need the bits",
    source="MAVSDK; QGroundControl; Mission Planner; ArduPilot GCS_MAVLink/GCS_Common.cpp",
)
def version(check: VehicleCheck) -> RowVerdict:
    """Judge the three ways and the capability bits."""
    found = Findings()
    ways = None if check.is_ardupilot else ("512/148",)
    answers = versions(check, check.main, ways)
    for way, frame in answers.items():
        found.expect(frame, f"{way}: {'answered' if frame else 'no AUTOPILOT_VERSION'}")
    frames = [one for one in answers.values() if one is not None]
    if not frames:
        return found.verdict()
    bits = int(frames[0].message.capabilities)
    needed = REQUIRED_CAPABILITIES if check.is_rover else ("MAVLINK2",)
    missing = [name for name in needed if not bits & capability(name)]
    found.expect(not missing, f"capabilities 0x{bits:x}" + f" without {missing}" * bool(missing))
    optional = _OPTIONAL if check.is_ardupilot else {}
    wrong = [name for name in optional if bits & capability(name) and not optional[name](check)]
    found.expect(not wrong, f"bits without a function: {wrong}")
    return found.verdict()


def _calibrates(check: VehicleCheck) -> bool:
    """Return True if the vehicle knows compass calibration: to cancel none changes nothing."""
    result = check.main.result_of(CANCEL_CALIBRATION)
    return result not in (None, mavlink.MAV_RESULT_UNSUPPORTED)


def _knows_terrain(check: VehicleCheck) -> bool:
    return check.main.ask(mavlink.MAVLink_terrain_check_message(0, 0), "TERRAIN_REPORT") is not None


_OPTIONAL: Final = {
    "PARAM_ENCODE_BYTEWISE": lambda check: False,  # contradicts PARAM_ENCODE_C_CAST
    "TERRAIN": _knows_terrain,
    "COMPASS_CALIBRATION": _calibrates,
}
"""Bits that a vehicle may have, and how to try what they promise."""


@row(
    70,
    "base_mode shows manual input in MANUAL and guidance in GUIDED; the bit of SET_ATTITUDE_TARGET",
    suffers="mavros: manual_input and guided of its state; clients that ask before they send",
    source="ArduPilot Rover/GCS_MAVLink_Rover.cpp",
    profiles=ROVER,
)
def mode_bits(check: VehicleCheck) -> RowVerdict:
    """Choose both modes while the vehicle is disarmed, and read its capabilities."""
    if check.is_armed:
        return not_tried("the vehicle is armed")
    found, before = Findings(), check.mode
    manual = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    guided = mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    for mode, set_bit, clear_bits in ((MANUAL, manual, guided), (GUIDED, guided, 0)):
        since = check.main.mark()
        result = check.set_mode(mode)
        if not found.expect(
            result == mavlink.MAV_RESULT_ACCEPTED,
            f"mode {mode}: {result_name(result)} {check.texts(since)}",
        ):
            continue
        check.station.wait(1.5, lambda: check.mode == mode)  # noqa: B023
        bits = check.heartbeat.base_mode
        is_right = check.mode == mode and bits & set_bit and not bits & clear_bits
        found.expect(is_right, f"mode {check.mode}: base_mode 0x{bits:02x}")
    check.set_mode(before)
    check.station.wait(1.5, lambda: check.mode == before)
    frame = next((one for one in versions(check, check.main).values() if one is not None), None)
    known = 0 if frame is None else int(frame.message.capabilities)
    found.expect(known & capability("SET_ATTITUDE_TARGET"), f"capabilities 0x{known:x}")
    return found.verdict()


@row(
    10,
    "flight_sw_version 4.x of type DEV, hash and unique id",
    suffers="QGroundControl: 'not latest stable' for type OFFICIAL, if the number is an old one",
    source="QGroundControl src/FirmwarePlugin",
    profiles=ARDUPILOTS,
)
def release(check: VehicleCheck) -> RowVerdict:
    """Judge the version fields."""
    frame = next((one for one in versions(check, check.main).values() if one is not None), None)
    if frame is None:
        return failed("no AUTOPILOT_VERSION")
    one, found = frame.message, Findings()
    number = one.flight_sw_version
    found.expect(number >> 24 == 4, f"version {number >> 24}.{number >> 16 & 0xFF}")
    kind = number & 0xFF
    found.expect(kind in RELEASE_TYPES, f"type {kind}")
    found.expect(any(one.flight_custom_version), f"hash {bytes(one.flight_custom_version)!r}")
    found.expect(one.uid or any(one.uid2), f"uid {one.uid:x}")
    verdict = found.verdict()
    if kind == OFFICIAL and verdict.status is RowStatus.PASS:
        return not_applicable(f"{verdict.evidence}: right for an official release of ArduPilot")
    return verdict
