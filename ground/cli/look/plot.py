"""`plot`: a recorded run as a picture."""

import argparse
import os
from pathlib import Path
from typing import Any, Final

from ground.client.connection import add_json
from ground.launch.child_command import command
from ground.launch.scenario import world_facts
from ground.recording.log_reader import Log, opened
from ground.recording.tables import figure
from ground.recording.tables.series import gathered
from ground.recording.tables.time_axis import Axis
from ground.recording.world_metadata import facts_of, radius_of
from ground.text.output import Says
from protocol.options import finite
from runtime.errors import UserError

KINDS: Final = (".png", ".svg")


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a .tlog or .mcap")
    says = "a .png or .svg (FILE.png)"
    parser.add_argument("--out", default="", metavar="FILE", help=says)
    says = "the world it was in; an .mcap knows it already"
    parser.add_argument("--world", metavar="W", help=says)
    says = "begin at this second of the robot's stamps"
    parser.add_argument("--from", dest="begin", type=finite, metavar="S", help=says)
    parser.add_argument("--to", dest="end", type=finite, metavar="S", help="end there")
    add_json(parser)


def run(options: argparse.Namespace, says: Says) -> int:
    """0 when there is a picture of all of it, 1 when part of the file is damaged."""
    source = Path(options.file)
    target = Path(options.out) if options.out else source.with_suffix(".png")
    if target.suffix not in KINDS:
        raise UserError(f"--out {target}: end it in .png or .svg")
    log = opened(source)
    if not sum(1 for _ in log):  # all of it: the facts may stand anywhere
        raise UserError(f"{source}: holds no frame{damaged(log)}")
    facts = facts_in(options.world, log)
    draw(options, target, log.robot, facts)
    told: dict[str, object] = {"file": str(source), "out": str(target), "damage": log.damage()}
    unknown = "" if facts else "; the world is not in it: --world W draws it"
    says.result(told, f"{target}{damaged(log)}{unknown}")
    return 1 if log.damage() else 0


def draw(options: argparse.Namespace, target: Path, robot: str, facts: dict[str, Any]) -> None:
    source = Path(options.file)
    found = gathered(Axis(opened(source), options.begin, options.end), radius_of(facts))
    if not (found.believed or found.true):
        raise UserError(f"{source}: there is no pose in that time, so there is nothing to draw")
    where = f" in {facts['name']}" if "name" in facts else ""
    try:
        figure.write(target, found, facts, f"{source.name}: {robot}{where}")
    except OSError as error:
        raise UserError(f"{target}: {error.strerror}") from error


def facts_in(world: str | None, log: Log) -> dict[str, Any]:
    if world is None:
        return facts_of(log.facts.get("world", ""))
    return world_facts(command(["worlds", "show", world, "--json"], os.getpid()))


def damaged(log: Log) -> str:
    return f" (DAMAGED: {log.damage()})" if log.damage() else ""
