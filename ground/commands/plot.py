"""`plot`: draw a recorded run as a picture."""

import os
from pathlib import Path
from typing import Final

from ground.client.outcomes import Progress, Report
from ground.commands.command import choice, command, option
from ground.commands.recordings import SUFFIXES, RecordingCommand
from ground.launch import child_command
from ground.launch.scenario import world_facts
from ground.map.scene import Shape
from ground.recording.figure import SCREEN, STYLES, FigureContents, write
from ground.recording.log_reader import Log, open_log
from ground.recording.tables import RunSeries, TimeAxis, collect_series
from ground.recording.world_metadata import world_of
from ground.station.robot.mission_items import MissionItems
from protocol.options import finite
from protocol.ring import RADIUS_M
from protocol.topics import ANSWERED, COMMANDED
from protocol.world import World, world_in
from runtime.cli.verb import REC
from runtime.errors import UserError

KINDS: Final = (".png", ".svg", ".pdf")


@command(REC, 50, "rec plot drive.mcap --out drive.svg", suffixes=SUFFIXES)
class Plot(RecordingCommand):
    """Draw a recorded run as a picture.

    `begin_s` and `end_s` are seconds of the robot's time stamps.
    """

    out: str = option(
        "--out", default="", metavar="FILE", help="a .png, .svg or .pdf (default FILE.png)"
    )
    style: str = choice(
        list(STYLES),
        "--style",
        default=SCREEN.name,
        parse=str,
        help=f"for the screen, or one column of a paper (default {SCREEN.name})",
    )
    world: str | None = option(
        "--world", default=None, metavar="W", help="the world of the run; an .mcap contains it"
    )
    begin_s: float | None = option(
        "--from",
        default=None,
        parse=finite,
        metavar="S",
        help="begin at this second of the robot's stamps",
    )
    end_s: float | None = option("--to", default=None, parse=finite, metavar="S", help="end there")

    def run(self, progress: Progress) -> Report:
        """Draw the picture; UserError if there is nothing to draw or it cannot be written."""
        if self.remark:
            progress.note(self.remark)
        source = Path(self.file)
        target = Path(self.out) if self.out else source.with_suffix(".png")
        if target.suffix not in KINDS:
            raise UserError(f"--out {target}: end it in .png, .svg or .pdf")
        log = open_log(source)
        if not sum(1 for _ in log):  # read all of it: the facts may be anywhere
            raise UserError(f"{source}: has no frame{damaged(log)}")
        world = world_driven(self.world, log)
        draw(self, target, log.robot, world)
        row = {"file": str(source), "out": str(target), "damage": log.damage()}
        unknown = "" if world else "; without the world: add it with --world W"
        return Report(not log.damage(), f"{target}{damaged(log)}{unknown}", row)


def draw(asked: Plot, target: Path, robot: str, world: World | None) -> None:
    """Draw the run into a file."""
    source = Path(asked.file)
    timed = TimeAxis(open_log(source), asked.begin_s, asked.end_s)
    found = collect_series(timed, RADIUS_M if world is None else world.radius_m)
    if not (found.estimated or found.true):
        raise UserError(f"{source}: has no pose in that time, so there is nothing to draw")
    run = FigureContents(found, world, fence_in(source), title_of(robot, world, found), source.name)
    try:
        write(target, run, STYLES[asked.style])
    except OSError as error:
        raise UserError(f"{target}: {error.strerror}") from error


def title_of(robot: str, world: World | None, found: RunSeries) -> str:
    """Return what happened in words: robot, world, and how each goal ended."""
    where = "" if world is None else f" in {world.name}"
    ends = [f"{one.text} at {one.time_s:.1f} s" for one in found.marks if one.kind == "outcome"]
    return f"{robot}{where}{f': {ends[-1]}' if ends else ''}"


def fence_in(source: Path) -> tuple[Shape, ...]:
    """Return the fence that was uploaded last in a recording."""
    items = MissionItems()
    uploads = {COMMANDED.path, ANSWERED.path}
    for one in TimeAxis(open_log(source)):
        if one.path in uploads:
            items.receive(one.message)
    return items.fence


def world_driven(name: str | None, log: Log) -> World | None:
    """Return the named world, or that in the recording, None if it holds none."""
    if name is None:
        return world_of(log.facts.get("world", ""))
    words = child_command.command(["worlds", "show", name, "--json"], os.getpid())
    return world_in(world_facts(words))


def damaged(log: Log) -> str:
    """Return the damage of a recording in parentheses, empty if there is none."""
    return f" (DAMAGED: {log.damage()})" if log.damage() else ""
