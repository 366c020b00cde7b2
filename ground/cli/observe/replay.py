"""`replay`: show a recorded run in the app or as lines, or execute it again with this build."""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from ground.app.appearance import add_appearance_options
from ground.app.start import has_screen, run_replay
from ground.client.status_line import watch_line
from ground.client.telemetry import Telemetry
from ground.commands.command import add_json, positive
from ground.launch.child_command import command
from ground.recording.catalogue import FILE_HELP, recording_named, remark_on
from ground.recording.playback import ReplayBus
from ground.text.output import Output
from ground.text.wording import Part, in_words
from protocol.navigators import CHOICES
from protocol.options import finite
from protocol.topics import TEXT
from protocol.wire.codec import decode
from protocol.wire.statustext import StatustextAssembler
from runtime.clock import Clock, WallClock
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S

EVERY_S: Final = 1.0
LARGE_BYTES: Final = 20_000_000
"""Size of a file that takes a second or two to read."""
REEXECUTE: Final = "reexecute"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `replay`."""
    parser.add_argument("file", nargs="?", metavar="FILE", help=FILE_HELP)
    text = "the robot, if the name of the file does not contain it"
    parser.add_argument("--id", metavar="NAME", help=text)
    parser.add_argument("--plain", action="store_true", help="one line per second of the run")
    parser.add_argument(
        "--at", type=finite, default=0.0, metavar="S", help="begin at this second (default 0)"
    )
    text = "print the lines at this multiple of real time; without it, all at once"
    parser.add_argument("--speed", type=positive, metavar="K", help=text)
    text = "run the core of this build on the recorded inputs; report the first difference"
    parser.add_argument("--re-execute", action="store_true", dest="again", help=text)
    text = "with --re-execute: find the first decision that this navigator makes otherwise"
    parser.add_argument("--navigator", choices=CHOICES, help=text)
    add_appearance_options(parser)
    add_json(parser)


def run(options: argparse.Namespace, output: Output) -> int:
    """Replay; return 0, or 1 if results differ or part of the file is damaged."""
    file = recording_named(options.file)
    if remark := remark_on(file, options.file):
        output.note(remark)
    options.file = str(file)
    if options.again:
        return reexecute(options)
    if options.navigator is not None:
        raise UserError(
            "--navigator needs --re-execute; `sidestep ghost` simulates another navigator"
        )
    if has_screen() and not (options.plain or options.json):
        return run_replay(options, file, options.id, options.at, reading(file, output))
    announce(file, output)
    return show_lines(options, output, WallClock())


def reading(file: Path, output: Output) -> Callable[[float], None]:
    """Return a display of the share of a file that was read, in a line that rewrites itself."""
    shown = ""

    def show(share: float) -> None:
        nonlocal shown
        words = f"reading {file.name}  {share:.0%}"
        if words != shown and output.live:
            output.line([Part(words)])
            shown = words

    return show


def announce(file: Path, output: Output) -> None:
    """Print a note if the file is large, because reading it takes seconds."""
    with suppress(OSError):
        size = file.stat().st_size
        if size > LARGE_BYTES:
            output.note(f"reading {file}, {size / 1e6:.0f} MB")


def reexecute(options: argparse.Namespace) -> int:
    """Run the re-execution in a process of its own, because the ground does not import the core."""
    words = [REEXECUTE, options.file]
    for name in ("id", "navigator"):
        value = getattr(options, name)
        words += [] if value is None else [f"--{name}", value]
    words += ["--json"] if options.json else []
    sys.stdout.flush()
    return subprocess.run(command(words, os.getpid()), check=False).returncode


def show_lines(options: argparse.Namespace, output: Output, clock: Clock) -> int:
    """Print states, texts and marks in the order of time; with --json only a summary."""
    bus = ReplayBus(Path(options.file), clock, options.id)
    if not options.json:
        began_ns = clock.now_ns()
        for time_s, line in lines(bus, options.at, EVERY_S):
            if options.speed is not None:
                due_s = (time_s - options.at) / options.speed
                clock.sleep_until(began_ns + round(due_s * NS_PER_S))
            print(f"{time_s:8.2f}  {line}", flush=True)
    output.result(summary(bus, options.file), in_words_of(bus))
    return 1 if bus.damage else 0


def lines(bus: ReplayBus, begin_s: float, every_s: float) -> Iterator[tuple[float, str]]:
    """Yield time (s) and text: the robot's texts and marks, and its state once per interval."""
    telemetry, texts = Telemetry(bus, bus.robot), StatustextAssembler()
    texts_found: list[tuple[float, str]] = []

    def take(_key: str, frame: bytes, arrived_ns: int) -> None:
        try:
            text = texts.receive(decode(frame).message)
        except RemoteError:
            return
        if text:
            texts_found.append(((arrived_ns - bus.log_index.start_ns) / NS_PER_S, f"robot: {text}"))

    bus.stream(TEXT, take)
    end_s = bus.timeline.duration_ns / NS_PER_S
    marks = [(mark.time_s, f"{mark.kind}: {mark.text}") for mark in bus.marks]
    time_s = begin_s
    bus.seek(begin_s)
    texts_found.clear()
    while True:
        yield time_s, in_words(watch_line(telemetry, bus.timeline.now_ns()))
        if time_s >= end_s:
            return
        before_s, time_s = time_s, min(time_s + every_s, end_s)
        bus.seek(time_s)
        yield from sorted([*texts_found, *(m for m in marks if before_s < m[0] <= time_s)])
        texts_found.clear()


def summary(bus: ReplayBus, file: str) -> dict[str, object]:
    """Return the contents of the recording as a row."""
    return {
        "file": file,
        "robot": bus.robot,
        "frames": len(bus.log_index),
        "duration_s": bus.timeline.duration_ns / NS_PER_S,
        "marks": [mark._asdict() for mark in bus.marks],
        "facts": sorted(bus.log_index.facts),
        "damage": bus.damage,
    }


def in_words_of(bus: ReplayBus) -> str:
    """Describe the recording in one line."""
    seconds = bus.timeline.duration_ns / NS_PER_S
    damage = f"; DAMAGED: {bus.damage}" if bus.damage else ""
    return f"{len(bus.log_index)} frames of {bus.robot} in {seconds:.1f} s{damage}"
