"""Rows 49 and 50: recordings by LOG_REQUEST and by files."""

from typing import Final

from ground.vehicle_check.check import Check
from ground.vehicle_check.dialect import mavlink
from ground.vehicle_check.files import END_OF_FILE, LIST, FileClient
from ground.vehicle_check.verdict import Findings, Verdict, failed, row

BLOCK: Final = 90
MAX_BYTES: Final = 900
ALL: Final = 0xFFFF
FOLDERS: Final = ("@MAV_LOG", "/APM/LOGS", "/fs/microsd/log")
"""The folders in which QGroundControl looks for logs: by name, on ArduPilot and on PX4."""


def entries(check: Check) -> dict[int, int]:
    """Return the size of each log by its number; the list is requested once."""
    if "logs" not in check.facts:
        target = check.target, check.station.target_component
        since = check.main.mark()
        message = mavlink.MAVLink_log_request_list_message(*target, 0, ALL)
        first = check.main.ask(message, "LOG_ENTRY", within_s=2.0)
        count = 0 if first is None else int(first.message.num_logs)

        def is_whole() -> bool:
            return len(check.main.heard("LOG_ENTRY", since)) >= count

        check.station.wait(2.0, is_whole)
        frames = check.main.heard("LOG_ENTRY", since)
        check.facts["logs"] = {one.message.id: one.message.size for one in frames}
        check.facts["log answers"] = [one.message.num_logs for one in frames]
    found: dict[int, int] = check.facts["logs"]
    return found


@row(
    49,
    "LOG_REQUEST_LIST and DATA: blocks of 90 bytes, a short last one, END stops",
    suffers="MAVProxy log, QGroundControl, Mission Planner, MAVSDK, mavros",
)
def logs(check: Check) -> Verdict:
    """List the logs, and read the start and the end of one."""
    logs = entries(check)
    counts = check.facts["log answers"]
    if not counts:
        return failed("LOG_REQUEST_LIST: no LOG_ENTRY")
    found = Findings()
    if counts[0] == 0:
        found.expect(len(counts) == 1, f"0 logs: {len(counts)} LOG_ENTRY")
        return found.verdict()
    found.expect(len(logs) >= min(counts[0], 1), f"{len(logs)} of {counts[0]} logs")
    number = max((one for one in logs if logs[one] > 0), default=None)
    if number is None:
        return found.verdict()
    size = logs[number]
    offset = max(0, (size - MAX_BYTES) // BLOCK * BLOCK)
    for start, wanted in ((0, min(size, MAX_BYTES)), (offset, size - offset)):
        data = _read(check, number, start, wanted)
        found.expect(len(data) == wanted, f"log {number} at {start}: {len(data)} of {wanted} B")
    since = check.main.mark()
    target = check.target, check.station.target_component
    check.main.send(mavlink.MAVLink_log_request_data_message(*target, number, 0, 0xFFFFFFFF))
    check.main.send(mavlink.MAVLink_log_request_end_message(*target))
    check.station.wait(0.6)
    middle = check.main.mark()
    check.station.wait(0.4)
    after = len(check.main.heard("LOG_DATA", middle))
    found.expect(
        not after, f"after END {after} blocks ({len(check.main.heard('LOG_DATA', since))})"
    )
    return found.verdict()


def _read(check: Check, number: int, offset: int, count: int) -> bytes:
    target = check.target, check.station.target_component
    parts: dict[int, bytes] = {}

    def is_whole() -> bool:
        for one in check.main.heard("LOG_DATA", since, lambda one: one.id == number):
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


def _expect_same_bytes(check: Check, found: Findings, folder: str, files: list[str]) -> None:
    """Compare the start of one log by both protocols: a log whose size is unique."""
    logs = entries(check)
    for line in files:
        name, _, size = line[1:].partition("\t")
        numbers = [one for one, length in logs.items() if length and str(length) == size]
        if len(numbers) != 1:
            continue
        wanted = min(logs[numbers[0]], MAX_BYTES)
        data = FileClient(check.main).fetch(folder + name)
        is_same = data is not None and data[:wanted] == _read(check, numbers[0], 0, wanted)
        found.expect(is_same, f"{name}: {'same bytes' if is_same else 'other bytes'}")
        return


@row(
    50,
    "the same recordings by an FTP listing",
    suffers="QGroundControl's newer log page",
)
def log_files(check: Check) -> Verdict:
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
