"""Rows 19-24, 67: parameters by messages and by files, the compatibility set, descriptions.

The groups of ArduRover's parameters are from ArduPilot/ParameterRepository, Rover 4.7.
"""

import json
import lzma
import re
from collections.abc import Sequence
from math import isfinite, nan
from typing import Any, Final
from zlib import crc32

from vehicle_check.ground_stations import GroundStation
from vehicle_check.mavlink_frames import mavlink
from vehicle_check.transfers import (
    CRC32,
    FILE_NOT_FOUND,
    LIST,
    NAK,
    NO_INDEX,
    OPEN,
    PCK_MAGIC_DEFAULTS,
    READ,
    RESET,
    TERMINATE,
    FileClient,
    ListedParameters,
    Value,
    download_parameters,
    name_of,
    read_parameter,
    unpacked,
    write,
)
from vehicle_check.vehicle_under_test import (
    ARDUPILOTS,
    HARSH_LOSS,
    ROVER,
    Findings,
    RowVerdict,
    VehicleCheck,
    failed,
    not_applicable,
    not_tried,
    row,
)

_TEXT: Final = """
    ACRO AEROM AFS AHRS AIS ALAND ARM ARMING ARSPD ATC AUTO AUX AVOID BAL BARO BATT BATTA
    BATTB BATTC BATTD BATTE BATTF BATTG BCN BRD BTAG BTN CAM CAN CFACT CGA CH CIRC COMPASS
    CRASH CRUISE CUST DDS DID DIST DJIR DOCK DR EAHRS EFI EK ENABLE ESC ESRC FENCE FFT FILT
    FLOW FLTMODE FOLL FOLLP FOLT FORMAT FRAME FRSKY FS GCS GEN GPS GRIP GUID INITIAL INS KDE
    LOG LOIT LTE MANUAL MAV MIS MNT MODE MOT MSP NET NMEA NTF OA OSD PARAM PILOT PIVOT PLND
    POI PORT PREV PRX PSC QUIK RALLY RC RCK RCMAP RELAY RK RNGFND RNGFNDA RPM RSSI RST RTL
    RTUN SAIL SCHED SCR SERIAL SERVO SHIP SIM SIMPLE SLUP SPEED SPRAY SRTL STAT STICK TA
    TEMP TERR THR TOFSENSE TRIK TRQ TRQL TURN UM VID VISO VTX WEB WENC WINCH WNDVN WP WRC
"""
GROUPS: Final = frozenset(_TEXT.split())
COMPATIBLE_GROUPS: Final = re.compile(
    r"(RCMAP|RC[0-9]+|COMPASS|INS|BATT|SYSID|MAV|FENCE)_|GUID_TIMEOUT"
)
"""Groups from which a vehicle may have parameters with ArduRover's meaning, and one parameter."""


def has_rover_name(name: str) -> bool:
    """Return True for a name in one of ArduRover's groups."""
    return re.sub(r"[0-9]+$", "", name.split("_")[0]) in GROUPS


def is_compatibility(name: str) -> bool:
    """Return True for a name that clients expect of every Rover."""
    return COMPATIBLE_GROUPS.match(name) is not None


KINDS: Final = frozenset(
    getattr(mavlink, f"MAV_PARAM_TYPE_{name}") for name in ("INT8", "INT16", "INT32", "REAL32")
)
"""The types that ArduPilot has; a float carries each of them exactly enough."""
REAL32: Final = mavlink.MAV_PARAM_TYPE_REAL32
PARAMETERS_PER_S: Final = 100
LOSSY_S: Final = 5.0
REMOTE_S: Final = 30.0
"""mavros waits so long for the list."""
PCK: Final = "@PARAM/param.pck"
BLOCK: Final = 110
WRONG_SESSION: Final = 77
METADATA: Final = 397
PARAMETER_METADATA: Final = 1
AXES: Final = ("X", "Y", "Z")
COMPATIBILITY: Final = (
    *(f"RCMAP_{one}" for one in ("ROLL", "PITCH", "YAW", "THROTTLE")),
    *(f"RC{number}_{one}" for number in range(1, 5) for one in ("MIN", "MAX", "TRIM")),
    *(f"COMPASS_DEV_ID{one}" for one in ("", "2", "3")),
    *(f"COMPASS_USE{one}" for one in ("", "2", "3")),
    *(f"COMPASS_OFS{one}_{axis}" for one in ("", "2", "3") for axis in AXES),
    *(f"INS_ACCOFFS_{axis}" for axis in AXES),
    "BATT_CAPACITY", "BATT_MONITOR",
)  # fmt: skip
DEFAULT_MIN: Final = 1100


def most_seconds(check: VehicleCheck, on_loopback_s: float, count: int) -> float:
    """Return how long something may take that sends a number of parameters."""
    if not check.station.network.is_loopback:
        return REMOTE_S
    least_s = LOSSY_S if check.station.is_lossy else on_loopback_s
    return max(least_s, count / PARAMETERS_PER_S)


def parameters(check: VehicleCheck) -> ListedParameters:
    """Return the list of the main client, which is requested once."""
    return check.once("parameters", lambda: download_parameters(check.main, REMOTE_S))


@row(
    19,
    "parameters: list within 1 s, stable indexes, signed integers and REAL32, sets told to all",
    suffers="every client: mavros waits 30 s, DroneKit asks 50 at a time",
    source="MAVLink guide, parameter protocol; mavros; DroneKit",
)
def parameter_protocol(check: VehicleCheck) -> RowVerdict:
    """Download the list, read some of it again, and set a value to itself."""
    found, listed = Findings(), parameters(check)
    most_s = most_seconds(check, 1.0, listed.count)
    seconds = listed.elapsed.seconds
    fact = f"{len(listed.values)} of {listed.count} parameters in {seconds:.2f} s"
    if not (
        found.expect(listed.is_whole, fact) and found.expect_in_time(listed.elapsed, most_s, fact)
    ):
        return found.verdict()
    if seconds > most_s:
        del check.facts["parameters"]  # to measure again, because this machine was busy
    kinds = sorted({value.kind for value in listed.values.values()})
    found.expect(set(kinds) <= KINDS, f"types {kinds}")
    long = [name for name in listed.values if len(name) > 16]
    found.expect(not long, f"{len(long)} names too long")
    names = list(listed.values)
    for name in {names[0], names[len(names) // 2], names[-1]}:
        index = listed.values[name].position
        for one in (read_parameter(check.main, name), read_parameter(check.main, index=index)):
            got = None if one is None else (name_of(one), one.param_index)
            # ArduPilot gives no index to a parameter that is read by its name.
            found.expect(got in ((name, index), (name, NO_INDEX)), f"read again: {got}")
    _expect_set(check, found, listed)
    return found.verdict()


def harmless_parameters(check: VehicleCheck, listed: ListedParameters) -> list[str]:
    """Return parameters of the vehicle's own that are numbers.

    A bytewise integer, as of PX4, is none that equals itself.
    """
    return [
        name
        for name, one in listed.values.items()
        if not is_compatibility(name)
        and (check.is_ardupilot or one.kind == REAL32)
        and isfinite(one.value)
    ]


def _expect_set(check: VehicleCheck, found: Findings, listed: ListedParameters) -> None:
    name = next(iter(harmless_parameters(check, listed)), "")
    if not name:
        return
    value = listed.values[name]
    other, since = check.second, check.second.mark()
    for wanted in (value.value, nan) if check.is_ardupilot else (value.value,):
        answer = write(check.main, name, wanted, value.kind)
        if answer is None and wanted != value.value:
            answer = read_parameter(check.main, name)  # ArduPilot ignores what is no number
        got = None if answer is None else answer.param_value
        is_right = found.expect(
            got == value.value, f"PARAM_SET {name} {wanted:g}: value in force {got}"
        )
        if not is_right:
            write(check.main, name, value.value, value.kind)
    if check.serves_two:
        echo = None
        for _ in range(check.station.tries):
            echo = other.expect_sent("PARAM_VALUE", 1.0, lambda one: name_of(one) == name, since)
            if echo is not None:
                break
            # With loss, a late answer to an earlier request can hide that the set was dropped.
            write(check.main, name, value.value, value.kind)
        found.expect(echo, f"the other client {'sees' if echo else 'does not see'} PARAM_VALUE")


CHANGE: Final = 1.01
TRIED: Final = 5
FORCE_S: Final = 1.0


@row(
    67,
    "PARAM_REQUEST_READ gives the value in force within a second of any change",
    suffers="every client: an old value is shown, and written back",
    source="MAVLink guide, parameter protocol",
)
def value_in_force(check: VehicleCheck) -> RowVerdict:
    """Change a parameter by a hundredth, read it from two clients, and set it back."""
    if check.is_armed:
        return not_tried("the vehicle is armed")
    found, listed = Findings(), parameters(check)
    readers = [check.main, check.second] if check.serves_two else [check.main]
    names = [one for one in harmless_parameters(check, listed) if listed.values[one].kind == REAL32]
    for name in [one for one in names if listed.values[one].value][:TRIED]:
        value = listed.values[name]
        for reader in readers:
            read_parameter(reader, name)
        answer = write(check.main, name, value.value * CHANGE, value.kind)
        if answer is None or answer.param_value == value.value:
            continue  # refused, or at the end of its range
        check.station.wait(FORCE_S)
        _expect_read(found, readers, name, answer.param_value)
        restored = write(check.main, name, value.value, value.kind)
        back = None if restored is None else restored.param_value
        check.station.wait(FORCE_S)
        _expect_read(found, readers, name, value.value)
        found.expect(back == value.value, f"{name} set back: {back}")
        return found.verdict()
    return failed(f"none of {len(names[:TRIED])} parameters could be changed by a hundredth")


def _expect_read(
    found: Findings, readers: Sequence[GroundStation], name: str, in_force: float
) -> None:
    for number, reader in enumerate(readers, start=1):
        one = read_parameter(reader, name)
        got = None if one is None else float(one.param_value)
        fact = f"{name} read by client {number}: {got}, in force {in_force:g}"
        found.expect(got == in_force, fact)


@row(
    20,
    "FTP: param.pck with its options; open, burst, read, list, CRC; NAK with the session",
    suffers="MAVProxy, Mission Planner, QGroundControl ask it first",
    source="ArduPilot AP_Filesystem_Param; MAVProxy; Mission Planner",
    profiles=ARDUPILOTS,
)
def file_protocol(check: VehicleCheck) -> RowVerdict:
    """Read param.pck by bursts of 110 bytes, with options, and send wrong requests."""
    found, ftp = Findings(), FileClient(check.main)
    reset = ftp.request(RESET)
    if not found.expect(reset is not None, f"ResetSessions: {_said(reset)}"):
        return found.verdict()
    opened = ftp.request(OPEN, f"{PCK}?withdefaults=1".encode())
    if found.expect(opened is not None and opened.is_ack, f"{PCK}: {_said(opened)}") and opened:
        size = int.from_bytes(opened.data[:4], "little")
        parts: dict[int, bytes] = {}
        for _ in range(check.station.tries):
            parts = parts or ftp.burst(opened.session, size, BLOCK)
        longest = max(map(len, parts.values()), default=0)
        found.expect(longest == min(BLOCK, size), f"burst blocks of {longest} bytes for {BLOCK}")
        offset = min(parts, default=0)
        first = ftp.request(READ, session=opened.session, offset=offset, size=60)
        is_same = first is not None and first.data == parts.get(offset, b"")[:60]
        found.expect(is_same, f"ReadFile {_said(first)}")
        ftp.request(TERMINATE, session=opened.session)
        _expect_packed(check, found, ftp)
    wrong = ftp.request(READ, session=WRONG_SESSION, size=10)
    is_right = wrong is not None and (wrong.opcode, wrong.session) == (NAK, WRONG_SESSION)
    found.expect(is_right, f"read in session {WRONG_SESSION}: {_said(wrong)}")
    absent = ftp.request(OPEN, b"@PARAM/no_such_file")
    is_right = absent is not None and absent.error == FILE_NOT_FOUND
    found.expect(is_right, f"absent file: {_said(absent)}")
    listed = ftp.request(LIST, b"@PARAM")
    found.expect(listed, f"List @PARAM: {_said(listed)}")
    checksum = ftp.request(CRC32, PCK.encode())
    is_right = checksum is not None and checksum.is_ack and len(checksum.data) >= 4
    found.expect(is_right, f"CalcCRC32: {_said(checksum)}")
    return found.verdict()


def _expect_packed(check: VehicleCheck, found: Findings, ftp: FileClient) -> None:
    whole = ftp.fetch(f"{PCK}?withdefaults=1")
    packed = None if whole is None else unpacked(whole)
    if not found.expect(packed, f"param.pck {'read' if packed else 'malformed'}") or not packed:
        return
    listed = parameters(check)
    missing = sorted(set(listed.values) - set(packed.values))
    found.expect(not missing, f"{len(packed.values)} parameters, missing {missing[:3]}")
    found.expect(packed.magic == PCK_MAGIC_DEFAULTS, f"with defaults: magic 0x{packed.magic:x}")
    some = ftp.fetch(f"{PCK}?start=2&count=3")
    part = None if some is None else unpacked(some)
    count = None if part is None else len(part.values)
    found.expect(count == 3, f"start=2&count=3: {count}")


def _said(reply: Any) -> str:
    if reply is None:
        return "no answer"
    return "ACK" if reply.is_ack else f"NAK error {reply.error} session {reply.session}"


@row(
    21,
    "parameters whole within 5 s by FTP with 20 % loss in both directions",
    suffers="every client on a radio",
    source="ArduPilot AP_Filesystem_Param",
    profiles=ARDUPILOTS,
)
def parameters_with_loss(check: VehicleCheck) -> RowVerdict:
    """Fetch param.pck while the judge drops frames."""
    losses = check.station.losses
    most_s = max(LOSSY_S, parameters(check).count / PARAMETERS_PER_S)
    before, losses.share = losses.share, HARSH_LOSS
    stopwatch = check.station.stopwatch()
    try:
        data = FileClient(check.main).fetch(PCK, within_s=most_s + 1)
    finally:
        losses.share = before
    elapsed = stopwatch.elapsed
    packed = None if data is None else unpacked(data)
    count = 0 if packed is None else len(packed.values)
    found = Findings()
    fact = f"{count} parameters in {elapsed.seconds:.1f} s"
    if found.expect(packed is not None and count == packed.given, fact):
        found.expect_in_time(elapsed, most_s, fact)
    return found.verdict()


@row(
    22,
    "parameters that QGroundControl expects of a Rover, as set up; no FRAME_CLASS of 0",
    suffers="QGroundControl: setup pages block",
    source="QGroundControl src/AutoPilotPlugins/APM",
    profiles=ROVER,
)
def compatibility(check: VehicleCheck) -> RowVerdict:
    """Judge names and values, and try to change one."""
    listed = parameters(check)
    if not listed.values:
        return failed("no parameters")
    found = Findings()
    missing = [name for name in COMPATIBILITY if name not in listed.values]
    found.expect(not missing, f"missing {missing[:6]} ({len(missing)})" if missing else "all there")
    frame = listed.values.get("FRAME_CLASS")
    found.expect(
        frame is None or frame.value, f"FRAME_CLASS {'no' if frame is None else frame.value}"
    )
    if missing:
        return found.verdict()
    values = {name: listed.values[name].value for name in COMPATIBILITY}
    least = [values[f"RC{number}_MIN"] for number in range(1, 5)]
    found.expect(any(one != DEFAULT_MIN for one in least), f"RC1..4_MIN {least}")
    wrong = [one or "1" for one in ("", "2", "3") if _is_uncalibrated(values, one)]
    found.expect(not wrong, f"compasses without calibration: {', '.join(wrong) or 'none'}")
    offsets = [values[f"INS_ACCOFFS_{axis}"] for axis in AXES]
    found.expect(any(offsets), f"INS_ACCOFFS {offsets}")
    if check.main.request(METADATA, "COMPONENT_METADATA") is None:
        found.fact("not written: without COMPONENT_METADATA they are ArduRover's own")
        return found.verdict()
    kept = _after_set(check, "RC1_MIN", listed.values["RC1_MIN"])
    found.expect(kept == values["RC1_MIN"], f"RC1_MIN after a set {kept}")
    return found.verdict()


def _is_uncalibrated(values: dict[str, float], compass: str) -> bool:
    """Return True for a compass that is there and used, but has no offsets."""
    is_used = values[f"COMPASS_DEV_ID{compass}"] and values[f"COMPASS_USE{compass}"]
    return bool(is_used) and not any(values[f"COMPASS_OFS{compass}_{axis}"] for axis in AXES)


def _after_set(check: VehicleCheck, name: str, value: Value) -> float | None:
    """Try to change a parameter; return its value then. Set it back if it has changed."""
    answer = write(check.main, name, value.value + 7, value.kind)
    if answer is None:
        return None
    if answer.param_value != value.value:
        write(check.main, name, value.value, value.kind)
    return float(answer.param_value)


@row(
    23,
    "COMPONENT_METADATA: descriptions of all parameters by FTP, with the right checksum",
    suffers="QGroundControl and MAVSDK: no texts, units and limits",
    source="MAVLink guide, component metadata; QGroundControl CompInfoParam.cc",
)
def metadata(check: VehicleCheck) -> RowVerdict:
    """Follow the links to the description of parameters."""
    found = Findings()
    answer = check.main.request(METADATA, "COMPONENT_METADATA")
    if answer is None:
        refusal = check.refusal_of(mavlink.MAV_CMD_REQUEST_MESSAGE, METADATA)
        return not_applicable(refusal) if refusal else failed("512/397: no COMPONENT_METADATA")
    uri = answer.message.uri.decode("ascii", "replace")
    data = _by_uri(check, uri)
    if not found.expect(data, f"{uri}: {'read' if data else 'cannot be read'}") or data is None:
        return found.verdict()
    sums = (crc32(data), crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF)
    found.expect(answer.message.file_crc in sums, f"file_crc 0x{answer.message.file_crc:x}")
    general = _json(uri, data)
    found.expect(general.get("version") == 1, f"version {general.get('version')}")
    types = {one.get("type"): one.get("uri", "") for one in general.get("metadataTypes", [])}
    described = types.get(PARAMETER_METADATA, "")
    inner = _by_uri(check, described)
    if not found.expect(inner, f"parameters: {described or 'no link'}") or inner is None:
        return found.verdict()
    names = {one.get("name") for one in _json(described, inner).get("parameters", [])}
    missing = sorted(set(parameters(check).values) - names)
    fact = f"{len(names)} described, missing {len(missing)} {missing[:3]}"
    found.expect(names and not missing, fact)
    return found.verdict()


def _by_uri(check: VehicleCheck, uri: str) -> bytes | None:
    path = uri.removeprefix("mftp://").removeprefix("mftp:")
    is_known = uri.startswith("mftp:") and path
    return FileClient(check.main).fetch(path) if is_known else None


def _json(name: str, data: bytes) -> dict[str, Any]:
    try:
        text = lzma.decompress(data, memlimit=2**26) if name.endswith(".xz") else data
        found = json.loads(text)
    except (lzma.LZMAError, ValueError, MemoryError):
        return {}
    return found if isinstance(found, dict) else {}


@row(
    24,
    "no parameter has a name of ArduRover with another meaning",
    suffers="QGroundControl: shows ArduRover's text and limits for it",
    source="QGroundControl CompInfoParam.cc; ArduPilot/ParameterRepository",
    profiles=ROVER,
)
def rover_names(check: VehicleCheck) -> RowVerdict:
    """Compare the names with the groups of ArduRover."""
    listed = parameters(check)
    if not listed.values:
        return failed("no parameters")
    answer = check.main.request(METADATA, "COMPONENT_METADATA")
    if answer is None:
        return not_applicable("no COMPONENT_METADATA: the names are taken for ArduRover's own")
    wrong = [name for name in listed.values if has_rover_name(name) and not is_compatibility(name)]
    found = Findings()
    found.expect(not wrong, f"in groups of ArduRover: {wrong[:6]}" if wrong else "none")
    return found.verdict()
