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
from ground.recording.log_writer import Recorder
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
        tape = tape_in(folder, link)
        link.bus.everything(tape.take)
        says.note(f"recording {link.robot} to {tape.path} and .mcap")
        shelf = Retention(folder, byte_limit(folder, options.keep))
        note(says, shelf.warning())
        try:
            keep_writing(link, tape, MetadataReader(link.bus, link.robot), shelf, says)
        except KeyboardInterrupt:
            with defer_signals():
                complete = tape.close()
        return tell(says, tape, complete=complete)


def tape_in(folder: Path, link: Link) -> DualLog:
    offset_ns = time_ns() - link.clock.now_ns()
    try:
        return DualLog.new(folder, link.robot, datetime.now(UTC), offset_ns)
    except OSError as error:
        raise UserError(f"cannot record in {folder}: {error.strerror or error}") from error


def keep_writing(
    link: Link, tape: DualLog, facts: MetadataReader, shelf: Retention, says: Output
) -> None:
    """Four rounds a second, one of them down to the disk; trouble is told at once and again."""
    alarms = Alarms(says)
    round_number = 0
    while True:
        due_ns = link.clock.now_ns() + FLUSH_NS
        if round_number % TIDY_EVERY == 0:
            note(says, shelf.tidy())
        round_number += 1
        with defer_signals():  # what a signal cut short would be half a chunk
            for name, text in facts.learned(link.clock.now_ns()).items():
                tape.know(name, text)
            tape.flush(round_number, SYNC_EVERY)
        alarms.look(tape, due_ns)
        link.clock.sleep_until(due_ns)


class Alarms:
    """Report problems of a recording at once, and every few seconds while they last."""

    def __init__(self, says: Output) -> None:
        self._says = says
        self._trouble_ns: int | None = None
        self._dropped_ns: int | None = None
        self._dropped = 0

    def look(self, tape: DualLog, now_ns: int) -> None:
        if not tape.trouble and self._trouble_ns is not None:
            self._says.note("RECORDING resumed: the log can be written again")
            self._trouble_ns = None
        elif tape.trouble and is_due(self._trouble_ns, now_ns):
            self._says.note(f"RECORDING IN TROUBLE: {tape.trouble}; the robot drives on")
            self._trouble_ns = now_ns
        if tape.dropped > self._dropped and is_due(self._dropped_ns, now_ns):
            self._dropped, self._dropped_ns = tape.dropped, now_ns
            self._says.note(f"RECORDING HAS LOST {tape.dropped} frames: {tape.why_dropped}")


def is_due(told_ns: int | None, now_ns: int) -> bool:
    """Return whether the problem was never reported, or some seconds ago."""
    return told_ns is None or now_ns - told_ns >= COMPLAIN_NS


def note(says: Output, words: str) -> None:
    if words:
        says.note(words)


def tell(says: Output, tape: DualLog, *, complete: bool) -> int:
    tlog, mcap = tape.tracks
    found: dict[str, object] = {"file": str(tlog.path), "mcap": str(mcap.path), "ok": complete}
    found |= account(tlog.recorder) | {"mcap_dropped": mcap.recorder.dropped}
    says.result(found, "\n".join(in_words(track) for track in tape.tracks))
    return 0 if complete else 1


def account(recorder: Recorder) -> dict[str, object]:
    return {
        "frames": recorder.written,
        "dropped": recorder.dropped,
        "rejected": recorder.rejected,
        "reason": recorder.trouble or recorder.why_dropped,
    }


def in_words(track: Track) -> str:
    recorder = track.recorder
    lost = f", {recorder.dropped} LOST ({recorder.why_dropped})" if recorder.dropped else ""
    odd = f", {recorder.rejected} no frames and left out" if recorder.rejected else ""
    return f"{track.path}: {recorder.written} frames{odd}{lost}"
