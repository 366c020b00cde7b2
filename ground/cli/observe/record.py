"""`record`: write every frame of a robot to a .tlog and an .mcap file."""

import argparse
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from time import time_ns
from typing import Final

from ground.cli.options import common_of
from ground.client.robot_link import RobotLink, open_link
from ground.commands.command import add_common
from ground.launch.child_processes import defer_signals
from ground.launch.recording_session import add_keep, byte_limit, created_line
from ground.recording.catalogue import Retention, part_bytes
from ground.recording.log_writer import FLUSH_NS, SYNC_EVERY, DualLog, LogWriter, Track
from ground.recording.metadata import MetadataReader
from ground.text.output import Output
from runtime.clock import Clock
from runtime.errors import UserError

TIDY_EVERY: Final = 240
REPEAT_NS: Final = 5_000_000_000
PAUSE_NS: Final = 30_000_000
LAST_FRAMES_NS: Final = 300_000_000


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `record`."""
    text = "folder for the new files <time>-<robot>.tlog and .mcap"
    parser.add_argument("folder", metavar="DIR", help=text)
    add_keep(parser)
    add_common(parser)


def run(options: argparse.Namespace, output: Output) -> int:
    """Record until a signal ends the process; return 1 if something could not be written."""
    common = common_of(options, output)
    with open_link(common) as link:
        folder = Path(options.folder)
        keep_bytes = byte_limit(folder, options.keep)
        log = new_log(folder, link, part_bytes(keep_bytes))
        link.bus.stream_all(log.take)
        output.note(created_line(link.name, log.path))
        retention = Retention(folder, keep_bytes, part_bytes(keep_bytes))
        note(output, retention.warning())
        facts = MetadataReader(link.bus, link.name)
        try:
            keep_writing(link, log, facts, retention, output)
        except KeyboardInterrupt:
            with defer_signals():
                add_facts(log, facts.request_missing())  # a short drive may end before the next try
                await_pause(log, link.clock)
                complete = log.close()
        return print_result(output, log, complete=complete)


def await_pause(log: DualLog, clock: Clock) -> None:
    """Wait until no frame has arrived for 30 ms, at most 0.3 s."""
    deadline_ns, taken = clock.now_ns() + LAST_FRAMES_NS, -1
    while taken != log.taken and clock.now_ns() < deadline_ns:
        taken = log.taken
        clock.sleep_until(clock.now_ns() + PAUSE_NS)


def new_log(folder: Path, link: RobotLink, part_bytes: int) -> DualLog:
    """Create the two files in a folder; UserError if that fails."""
    offset_ns = time_ns() - link.clock.now_ns()
    try:
        now = datetime.now(UTC)
        return DualLog.new(folder, link.name, now, offset_ns, part_bytes=part_bytes)
    except OSError as error:
        raise UserError(f"cannot record in {folder}: {error.strerror or error}") from error


def keep_writing(
    link: RobotLink, log: DualLog, facts: MetadataReader, retention: Retention, output: Output
) -> None:
    """Flush four times a second, and sync to disk once a second; report problems."""
    alarms = Alarms(output)
    round_number = parts = 0
    while True:
        due_ns = link.clock.now_ns() + FLUSH_NS
        if round_number % TIDY_EVERY == 0 or log.parts != parts:
            parts = log.parts
            note(output, retention.delete_oldest())
        round_number += 1
        with defer_signals():  # a signal must not leave half a chunk
            add_facts(log, facts.poll(link.clock.now_ns()))
            log.flush(round_number, SYNC_EVERY)
        alarms.look(log, due_ns)
        link.clock.sleep_until(due_ns)


def add_facts(log: DualLog, facts: Mapping[str, str]) -> None:
    """Add the facts, JSON texts by name."""
    for name, text in facts.items():
        log.add_fact(name, text)


class Alarms:
    """Reports problems of a recording at once, and every few seconds while they last."""

    def __init__(self, output: Output) -> None:
        self._output = output
        self._failed_ns: int | None = None
        self._dropped_ns: int | None = None
        self._dropped = 0

    def look(self, log: DualLog, now_ns: int) -> None:
        """Report new and lasting problems, and their end."""
        if not log.error and self._failed_ns is not None:
            self._output.note("RECORDING resumed: the log can be written again")
            self._failed_ns = None
        elif log.error and is_due(self._failed_ns, now_ns):
            self._output.note(f"RECORDING FAILS: {log.error}; the robot drives on")
            self._failed_ns = now_ns
        if log.dropped > self._dropped and is_due(self._dropped_ns, now_ns):
            self._dropped, self._dropped_ns = log.dropped, now_ns
            self._output.note(f"RECORDING HAS LOST {log.dropped} frames: {log.drop_reason}")


def is_due(reported_ns: int | None, now_ns: int) -> bool:
    """Return whether the problem was never reported, or some seconds ago."""
    return reported_ns is None or now_ns - reported_ns >= REPEAT_NS


def note(output: Output, words: str) -> None:
    """Print a note unless it is empty."""
    if words:
        output.note(words)


def print_result(output: Output, log: DualLog, *, complete: bool) -> int:
    """Print the result; return 0 if the recording is complete."""
    tlog, mcap = log.tracks
    found: dict[str, object] = {"file": str(tlog.path), "mcap": str(mcap.path), "ok": complete}
    found |= account(tlog.writer) | {"mcap_dropped": mcap.writer.dropped}
    output.result(found, "\n".join(in_words(track, log.parts) for track in log.tracks))
    return 0 if complete else 1


def account(writer: LogWriter) -> dict[str, object]:
    """Return the counts of a log writer as a row."""
    return {
        "frames": writer.written,
        "dropped": writer.dropped,
        "rejected": writer.rejected,
        "reason": writer.error or writer.drop_reason,
    }


def in_words(track: Track, parts: int) -> str:
    """Describe the files of one kind."""
    writer = track.writer
    lost = f", {writer.dropped} LOST ({writer.drop_reason})" if writer.dropped else ""
    several = f" in {parts} parts" if parts > 1 else ""
    odd = f", {writer.rejected} invalid frames left out" if writer.rejected else ""
    return f"{track.path}: {writer.written} frames{several}{odd}{lost}"
