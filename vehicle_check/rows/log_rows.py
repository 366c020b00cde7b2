"""Rows 49 and 50: recordings by LOG_REQUEST and by files."""

from typing import Final

from runtime.units import NS_PER_S
from vehicle_check import row_steps
from vehicle_check.ground_stations import ReceivedMessage
from vehicle_check.mavlink_frames import MavMessage, mavlink
from vehicle_check.transfers import END_OF_FILE, LIST, FileClient
from vehicle_check.vehicle_under_test import Findings, RowVerdict, VehicleCheck, failed, row

BLOCK: Final = 90
MAX_BYTES: Final = 900
ALL: Final = 0xFFFF
MOST_LOGS: Final = 500
MOST_BYTES: Final = 0xFFFFFFFF
LIST_NS: Final = 30 * NS_PER_S
END_S: Final = 0.05
ARMED_S: Final = 0.3
FOLDERS: Final = ("@MAV_LOG", "/APM/LOGS", "/fs/microsd/log")
"""The folders in which QGroundControl looks for logs: by name, on ArduPilot and on PX4."""


def entries(check: VehicleCheck) -> dict[int, int]:
    """Return the size of each log by its number; the list is requested once."""
    return {one.message.id: one.message.size for one in check.once("logs", lambda: _listed(check))}


def _listed(check: VehicleCheck) -> list[ReceivedMessage]:
    """Request the list, and wait as long as entries arrive."""
    since = check.main.mark()
    message = mavlink.MAVLink_log_request_list_message(*check.station.address, 0, ALL)
    first = check.main.ask(message, "LOG_ENTRY", within_s=2.0)
    count = 0 if first is None else int(first.message.num_logs)
    end_ns = check.station.now_ns + LIST_NS

    def is_missing() -> bool:
        ids = {one.message.id for one in check.main.heard("LOG_ENTRY", since)}
        return len(ids) < count and check.station.now_ns < end_ns

    for _ in range(check.station.tries):
        while is_missing() and check.main.expect("LOG_ENTRY", 2.0):
            pass
        if not is_missing():
            break
        check.main.send(message)
    return check.main.heard("LOG_ENTRY", since)


@row(
    49,
    "LOG_REQUEST_LIST and DATA: blocks of 90 bytes, a short last one, END stops, none while armed",
    suffers="MAVProxy log, QGroundControl, Mission Planner, MAVSDK, mavros",
    source="MAVLink guide, common.xml LOG_*; MAVProxy; QGroundControl; mavros",
)
def logs(check: VehicleCheck) -> RowVerdict:
    """List the logs, and read the start and the end of one; with motion, none while armed."""
    logs = entries(check)
    counts = [one.message.num_logs for one in check.facts["logs"]]
    if not counts:
        return failed("LOG_REQUEST_LIST: no LOG_ENTRY")
    found = Findings()
    if counts[0] == 0:
        found.expect(len(counts) == 1 or check.station.is_lossy, f"0 logs: {len(counts)} LOG_ENTRY")
        return found.verdict()
    found.expect(len(logs) >= min(counts[0], MOST_LOGS), f"{len(logs)} of {counts[0]} logs")
    number = max((one for one in logs if logs[one] > 0), default=None)
    if number is None:
        return found.verdict()
    size = logs[number]
    offset = max(0, (size - MAX_BYTES) // BLOCK * BLOCK)
    for start, wanted in ((0, min(size, MAX_BYTES)), (offset, size - offset)):
        data = read_log(check, number, start, wanted)
        found.expect(len(data) == wanted, f"log {number} at {start}: {len(data)} of {wanted} B")
    _expect_end(check, found, number)
    if check.options.allow_motion and row_steps.start(check, row_steps.GUIDED, found):
        check.station.wait(ARMED_S)
        data = read_log(check, number, 0, BLOCK)
        found.expect(not data, f"while armed {len(data)} B")
        row_steps.stand(check)
        check.station.wait(ARMED_S)
    return found.verdict()


def _expect_end(check: VehicleCheck, found: Findings, number: int) -> None:
    """Ask for a whole log and end it at once; expect blocks of 90 bytes, and none after the end."""
    since, target = check.main.mark(), check.station.address
    check.main.send_surely(mavlink.MAVLink_log_request_data_message(*target, number, 0, MOST_BYTES))
    check.station.wait(END_S)
    check.main.send_surely(mavlink.MAVLink_log_request_end_message(*target))
    check.station.wait(0.6)
    blocks = [one.message for one in check.main.sent("LOG_DATA", since)]
    size = entries(check)[number]
    wrong = [one.ofs for one in blocks if one.count != BLOCK and one.ofs + one.count < size]
    found.expect(not wrong, f"blocks of 90 bytes, others at {wrong[:3]}")
    middle = check.main.mark()
    check.station.wait(0.4)
    after = len(check.main.sent("LOG_DATA", middle))
    found.expect(not after, f"after END {after} blocks")


def read_log(check: VehicleCheck, number: int, offset: int, count: int) -> bytes:
    """Return a part of a log, as far as it arrives; late blocks of other parts do not count."""
    target, end = check.station.address, offset + count
    parts: dict[int, bytes] = {}

    def is_of_part(block: MavMessage) -> bool:
        return bool(block.id == number and offset <= block.ofs < end)

    def is_whole() -> bool:
        for one in check.main.heard("LOG_DATA", since, is_of_part):
            parts[one.message.ofs] = bytes(one.message.data[: one.message.count])
        return sum(map(len, parts.values())) >= count

    for _ in range(check.station.tries):
        since = check.main.mark()
        check.main.send(mavlink.MAVLink_log_request_data_message(*target, number, offset, count))
        if check.station.wait(1.5, is_whole):
            break
    found = bytearray()
    while offset in parts and parts[offset] and len(found) < count:
        found += parts[offset]
        offset += len(parts[offset])
    return bytes(found)


def _expect_same_bytes(check: VehicleCheck, found: Findings, folder: str, files: list[str]) -> None:
    """Compare the start of one log by both protocols: a log whose size is unique."""
    logs = entries(check)
    for line in files:
        name, _, size = line[1:].partition("\t")
        numbers = [one for one, length in logs.items() if length and str(length) == size]
        if len(numbers) != 1:
            continue
        wanted = min(logs[numbers[0]], MAX_BYTES)
        data = FileClient(check.main).fetch(folder + name, at_most=wanted)
        is_same = data is not None and data == read_log(check, numbers[0], 0, wanted)
        found.expect(is_same, f"{name}: {'same bytes' if is_same else 'other bytes'}")
        return


@row(
    50,
    "the same recordings by an FTP listing",
    suffers="QGroundControl's newer log page",
    source="QGroundControl OnboardLogs",
)
def log_files(check: VehicleCheck) -> RowVerdict:
    """List the folder of logs, and compare the number of files."""
    found, ftp = Findings(), FileClient(check.main)
    sizes = sorted(size for size in entries(check).values() if size)
    for folder in FOLDERS:
        names: list[str] = []
        while True:
            reply = ftp.request(LIST, folder.encode(), offset=len(names))
            if reply is None or not reply.is_ack:
                break
            lines = [one for one in reply.data.decode("utf-8", "replace").split("\0") if one]
            if not lines:
                break
            names += lines
        files = [one for one in names if one.startswith("F")]
        if files or (reply is not None and reply.error == END_OF_FILE):
            fact = f"{folder}: {len(files)} files, {len(sizes)} logs by LOG_REQUEST_LIST"
            found.expect(len(files) >= len(sizes), fact)
            _expect_same_bytes(check, found, f"{folder}/", files)
            return found.verdict()
    return failed(f"none of {', '.join(FOLDERS)} can be listed")
