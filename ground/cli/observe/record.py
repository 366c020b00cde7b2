"""`record`: the black box while it is written."""

import argparse
from datetime import UTC, datetime
from pathlib import Path
from time import time_ns
from typing import Final

from ground.cli.options import common_of
from ground.client.link import Link, open_link
from ground.grammar.words import add_common
from ground.launch.child_processes import defer_signals
from ground.launch.recording_session import add_keep, byte_limit
from ground.recording.dual_log import DualLog, Track
from ground.recording.log_writer import LogWriter
from ground.recording.metadata import MetadataReader
from ground.recording.retention import Retention
from ground.text.output import Output
from runtime.errors import UserError

FLUSH_NS: Final = 250_000_000
SYNC_EVERY: Final = 4
TIDY_EVERY: Final = 240
COMPLAIN_NS: Final = 5_000_000_000


def arguments(parser: argparse.ArgumentParser) -> None:
    says = "where DIR/<time>-<robot>.tlog and .mcap are made"
    parser.add_argument("folder", metavar="DIR", help=says)
    add_keep(parser)
    add_common(parser)


def run(options: argparse.Namespace, says: Output) -> int:
    """Until a signal ends it; 1 when something could not be written."""
    common = common_of(options)
    with open_link(common) as link:
        folder = Path(options.folder)
        dual_log = dual_log_in(folder, link)
        link.bus.everything(dual_log.take)
        says.note(f"recording {link.robot} to {dual_log.path} and .mcap")
        shelf = Retention(folder, byte_limit(folder, options.keep))
        note(says, shelf.warning())
        try:
            keep_writing(link, dual_log, MetadataReader(link.bus, link.robot), shelf, says)
        except KeyboardInterrupt:
            with defer_signals():
                complete = dual_log.close()
        return tell(says, dual_log, complete=complete)


def dual_log_in(folder: Path, link: Link) -> DualLog:
    offset_ns = time_ns() - link.clock.now_ns()
    try:
        return DualLog.new(folder, link.robot, datetime.now(UTC), offset_ns)
    except OSError as error:
        raise UserError(f"cannot record in {folder}: {error.strerror or error}") from error


def keep_writing(
    link: Link, dual_log: DualLog, facts: MetadataReader, shelf: Retention, says: Output
) -> None:
    """Four rounds a second, one of them down to the disk; trouble is told at once and again."""
    alarms = Alarms(says)
    round_number = 0
    while True:
        due_ns = link.clock.now_ns() + FLUSH_NS
        if round_number % TIDY_EVERY == 0:
            note(says, shelf.delete_oldest())
        round_number += 1
        with defer_signals():  # what a signal cut short would be half a chunk
            for name, text in facts.poll(link.clock.now_ns()).items():
                dual_log.add_fact(name, text)
            dual_log.flush(round_number, SYNC_EVERY)
        alarms.look(dual_log, due_ns)
        link.clock.sleep_until(due_ns)


class Alarms:
    """Report problems of a recording at once, and every few seconds while they last."""

    def __init__(self, says: Output) -> None:
        self._says = says
        self._trouble_ns: int | None = None
        self._dropped_ns: int | None = None
        self._dropped = 0

    def look(self, dual_log: DualLog, now_ns: int) -> None:
        if not dual_log.error and self._trouble_ns is not None:
            self._says.note("RECORDING resumed: the log can be written again")
            self._trouble_ns = None
        elif dual_log.error and is_due(self._trouble_ns, now_ns):
            self._says.note(f"RECORDING IN TROUBLE: {dual_log.error}; the robot drives on")
            self._trouble_ns = now_ns
        if dual_log.dropped > self._dropped and is_due(self._dropped_ns, now_ns):
            self._dropped, self._dropped_ns = dual_log.dropped, now_ns
            self._says.note(f"RECORDING HAS LOST {dual_log.dropped} frames: {dual_log.drop_reason}")


def is_due(told_ns: int | None, now_ns: int) -> bool:
    """Return whether the problem was never reported, or some seconds ago."""
    return told_ns is None or now_ns - told_ns >= COMPLAIN_NS


def note(says: Output, words: str) -> None:
    if words:
        says.note(words)


def tell(says: Output, dual_log: DualLog, *, complete: bool) -> int:
    tlog, mcap = dual_log.tracks
    found: dict[str, object] = {"file": str(tlog.path), "mcap": str(mcap.path), "ok": complete}
    found |= account(tlog.writer) | {"mcap_dropped": mcap.writer.dropped}
    says.result(found, "\n".join(in_words(track) for track in dual_log.tracks))
    return 0 if complete else 1


def account(writer: LogWriter) -> dict[str, object]:
    return {
        "frames": writer.written,
        "dropped": writer.dropped,
        "rejected": writer.rejected,
        "reason": writer.error or writer.drop_reason,
    }


def in_words(track: Track) -> str:
    writer = track.writer
    lost = f", {writer.dropped} LOST ({writer.drop_reason})" if writer.dropped else ""
    odd = f", {writer.rejected} no frames and left out" if writer.rejected else ""
    return f"{track.path}: {writer.written} frames{odd}{lost}"
