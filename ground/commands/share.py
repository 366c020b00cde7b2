"""`share`: put a recording into one .zip, with its plot, explanation and how to repeat it."""

import json
from math import degrees, isfinite
from pathlib import Path
from shlex import join
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from ground.client.outcomes import Progress, Report
from ground.client.vocabulary import SIDES
from ground.commands.command import command, option
from ground.commands.plot import Plot
from ground.commands.recordings import SUFFIXES, RecordingCommand
from ground.explain import RecordedDecisions
from ground.recording.log_reader import LogIndex, files_of, open_log
from protocol.navigators import NAVIGATORS
from protocol.topics import STATUS
from protocol.wire.messages import NavigatorStatus
from protocol.world import WorldRun, run_in
from runtime.cli.terminal import printable_lines
from runtime.cli.verb import LOOK
from runtime.errors import UserError
from runtime.files import drafted, value_in
from runtime.units import NS_PER_S

WORLD: Final = "world.json"
PICTURE: Final = "plot.png"
EXPLANATION: Final = "explanation.txt"
README: Final = "README.txt"
MADE: Final = (1980, 1, 1, 0, 0, 0)
"""Time of every file in the archive, so that equal recordings give equal archives."""


@command(LOOK, 70, "share drive.mcap --out drive.zip", suffixes=SUFFIXES)
class Share(RecordingCommand):
    """Put a recording, its plot and its explanation into one .zip."""

    out: str = option("--out", default="", metavar="FILE", help="a .zip (default FILE.zip)")

    def run(self, progress: Progress) -> Report:
        """Write the archive; UserError if the recording cannot be read or nothing be written."""
        if self.remark:
            progress.note(self.remark)
        source = Path(self.file)
        target = Path(self.out) if self.out else source.with_suffix(".zip")
        if target.suffix != ".zip":
            raise UserError(f"--out {target}: end it in .zip")
        log_index = LogIndex(open_log(source))
        picture = picture_of(source, progress)
        drive = drive_of(log_index)
        texts = {
            README: readme(source.name, log_index, drive, has_picture=bool(picture)),
            EXPLANATION: explanation(log_index),
        }
        # Names and words of a recording may hold anything, and their reader prints these files.
        contents = {name: printable_lines(text).encode() for name, text in texts.items()}
        if picture:
            contents[PICTURE] = picture
        if drive.run:
            contents[WORLD] = (json.dumps(drive.run.facts, indent=1) + "\n").encode()
        try:
            write(target, files_of(source) or [source], contents)
        except OSError as error:
            raise UserError(f"{target}: {error.strerror}") from error
        damage = f" (DAMAGED: {log_index.damage})" if log_index.damage else ""
        row = {"file": str(source), "out": str(target), "damage": log_index.damage}
        return Report(not log_index.damage, f"{target}{damage}", row)


class DrivenRun(NamedTuple):
    """What was driven: the world, if known, and the options of `up` that repeat it."""

    run: WorldRun | None
    options: list[str]
    changed: list[list[str]]
    """Commands that set the parameters which differ from those at the robot's start."""


def drive_of(log_index: LogIndex) -> DrivenRun:
    """Return what is known of the drive; it begins with the first goal."""
    try:
        run = run_in(log_index.facts.get("world", ""))
    except ValueError:
        run = None
    options: list[str] = []
    statuses = (one for _, one in log_index.on(STATUS.path) if type(one) is NavigatorStatus)
    first = next((status for status in statuses if isfinite(status.goal_x_m)), None)
    if first is not None:
        options += setting("--navigator", first.navigator, NAVIGATORS)
        options += setting("--side", first.side, SIDES)
        options += ["--goal", f"{first.goal_x_m:.6g}", f"{first.goal_y_m:.6g}"]
        if isfinite(first.goal_heading_rad):
            options.append(f"{degrees(first.goal_heading_rad):.6g}")
    if run is not None and run.seed is not None:
        options += ["--seed", str(run.seed)]
    if run is not None and run.noise_level is not None:
        options += ["--noise", run.noise_level]
    return DrivenRun(run, options, changed_parameters(log_index.facts.get("parameters", "")))


def setting(option: str, number: int, names: Any) -> list[str]:
    """Return an option with the name of a number, or nothing for an unknown number."""
    found = [name for name, known in names.items() if known == number]
    return [option, found[0]] if found else []


def changed_parameters(text: str) -> list[list[str]]:
    """Return a command for each recorded parameter that an operator had changed."""
    try:
        rows = [(row["name"], row["value"], row["configured"]) for row in value_in(text)]
    except (ValueError, TypeError, KeyError):
        return []
    return [
        ["param", "set", str(name), f"{value:.9g}"]
        for name, value, configured in rows
        if value != configured
    ]


def readme(file: str, log_index: LogIndex, drive: DrivenRun, *, has_picture: bool) -> str:
    """Return what the archive holds and how the run is repeated."""
    stem = Path(file).stem
    held = [f"{stem}.*: every message of the run", f"{EXPLANATION}: why the robot turned, and when"]
    if has_picture:
        held.append(f"{PICTURE}: path, ranges, speeds and position error")
    if drive.run:
        held.append(f"{WORLD}: the world, for `--world`")
    look = [["replay", file], ["rec", "plot", file], ["rec", "reexecute", file]]
    again = [*drive.changed]
    if drive.run:
        again.insert(0, ["up", "--world", WORLD, *drive.options, "--headless"])
    lines = [
        f"Sidestep: {log_index.robot}, {log_index.duration_ns / NS_PER_S:.1f} s",
        "",
        "In this archive:",
        *(f"  {line}" for line in held),
        "",
        "Look at the run, and execute the robot's program on the recorded sensor data again:",
        *(f"  {join(['sidestep', *words])}" for words in look),
    ]
    if again:
        lines += ["", "Drive the same again:"]
        lines += (f"  {join(['sidestep', *words])}" for words in again)
        if drive.run and drive.run.seed is None:
            lines.append("  (the seed is not in the recording: add --seed S unless it was 0)")
    if log_index.damage:
        lines += ["", f"DAMAGED: {log_index.damage}"]
    return "\n".join(lines) + "\n"


def explanation(log_index: LogIndex) -> str:
    """Return the explanation of every turning point."""
    recorded = RecordedDecisions(log_index)
    parts = []
    for turn in recorded.turns():
        found = recorded.at(turn.at_ns)
        if found is not None:
            parts.append(f"{turn.at_ns / NS_PER_S:.2f} s  {turn.words}\n{found[1].text()}\n")
    return "\n".join(parts) if parts else "the decision never changed\n"


def picture_of(source: Path, progress: Progress) -> bytes:
    """Return the plot of the run; empty, with the reason as a note, if it cannot be drawn."""
    with TemporaryDirectory() as folder:
        out = Path(folder) / PICTURE
        try:
            Plot(file=str(source), out=str(out)).run(progress)
        except UserError as error:
            progress.note(f"without {PICTURE}: {error}")
            return b""
        return out.read_bytes()


def write(target: Path, recordings: list[Path], contents: dict[str, bytes]) -> None:
    """Write the archive; after an error no part of it is left. Raises OSError."""
    with drafted(target) as draft, ZipFile(draft, "w", ZIP_DEFLATED) as archive:
        for name, data in contents.items():
            archive.writestr(entry(name), data)
        for path in recordings:
            archive.writestr(entry(path.name), path.read_bytes())


def entry(name: str) -> ZipInfo:
    """Return the entry of a file that anybody may read."""
    info = ZipInfo(name, MADE)
    info.compress_type = ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    return info
