"""`mission`: check, send and fetch a mission, start it, stop it, and say how far it is."""

import argparse
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

from ground.cli.command.simple_commands import tell
from ground.client.arming import insist
from ground.client.connection import add_common, add_json, common_of
from ground.client.link import Link, linked
from ground.client.requests import Answered
from ground.missions import files
from ground.missions.items import home_at
from ground.missions.mission import Home, Mission
from ground.missions.progress import mission_status, show_status
from ground.missions.sift import Foreign
from ground.missions.transfer import Clear, Downloaded, Upload, Verdict
from ground.missions.transport import fetch, send, send_fence, tell_verdict
from ground.missions.wire import fence_of, items_of, waypoints_of
from ground.text.output import Says
from protocol.options import finite, whole
from protocol.wire.enums import Command, MissionState, MissionType
from protocol.wire.messages import CommandRequest
from protocol.wire.reasons import Reason
from runtime.errors import UserError

MOST_ITEMS: Final = 65_535
"""People count items from 1; the wire begins with 0."""
OFFLINE: Final = ("check", "convert")
CURRENT: Final = -1
NO_MISSION: Final = Verdict(Reason.NO_MISSION, None)


def arguments(parser: argparse.ArgumentParser) -> None:
    names = "check|upload|download|list|start|pause|resume|abort|jump|status|clear|convert"
    actions = parser.add_subparsers(dest="action", required=True, metavar=names)
    checking = actions.add_parser("check", help="say what is wrong with a file")
    converting = actions.add_parser("convert", help="from one format to another, by the endings")
    checking.add_argument("file", type=Path, metavar="FILE", help=".toml, .plan or .waypoints")
    converting.add_argument("file", type=Path, metavar="IN")
    converting.add_argument("out", type=Path, metavar="OUT")
    uploading = actions.add_parser("upload", help="give it to the robot, with its fence if any")
    downloading = actions.add_parser("download", help="write what the robot has to a file")
    for action in (uploading, downloading):
        action.add_argument("file", type=Path, metavar="FILE", help=".toml, .plan or .waypoints")
    starting = actions.add_parser("start", help="drive it, from an item on")
    starting.add_argument(
        "item",
        nargs="?",
        type=whole(1, MOST_ITEMS),
        metavar="ITEM",
        help="from 1; without it the current one, or the first of a mission that is done",
    )
    jumping = actions.add_parser("jump", help="go on with another item")
    jumping.add_argument("item", type=whole(1, MOST_ITEMS), metavar="ITEM", help="from 1")
    orders = {"pause": "stand still", "resume": "go on", "abort": "drop it and stand still"}
    looks = {"list": "the items the robot has", "status": "how far it is"}
    others = {**orders, **looks, "clear": "delete it from the robot"}
    plain = [actions.add_parser(name, help=says) for name, says in others.items()]
    for action in (checking, converting, uploading, downloading):
        _add_reading(action)
    for action in (checking, converting):
        add_json(action)
    for action in (uploading, downloading, starting, jumping, *plain):
        add_common(action)


def _add_reading(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--home",
        nargs=2,
        type=finite,
        metavar=("LATITUDE", "LONGITUDE"),
        help="where x and y are 0 on Earth, x east and y north, for .plan and .waypoints",
    )
    parser.add_argument(
        "--drop", action="store_true", help="leave out what the robot cannot do, and say what"
    )


def run(options: argparse.Namespace, says: Says) -> int:
    if options.action in OFFLINE:
        return with_files(options, says)
    if options.action == "upload":
        read(options)  # what cannot be a mission is refused before anybody is dialled
    with linked(common_of(options)) as link:
        return act(options, link, says)


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    if options.action in OFFLINE:
        return with_files(options, says)
    if options.action == "upload":
        return upload(link, says, read(options))
    if options.action == "download":
        return download(link, says, options.file, home_of(options))
    if options.action == "list":
        return listing(link, says)
    if options.action == "status":
        return show_status(link, says)
    if options.action == "clear":
        verdict = send(link, Clear(MissionType.MISSION, link.clock.now_ns()))
        return tell_verdict(says, "mission clear", link, verdict, "ok, the robot has none")
    return order(options, link, says)


def order(options: argparse.Namespace, link: Link, says: Says) -> int:
    """A command to the mission that the robot has."""
    verb = f"mission {options.action}"
    if options.action == "start":
        answered = start(link, says, options.item)
    else:
        answered = link.ask(command_of(options, link))
    return tell(says, verb, link, answered)


def start(link: Link, says: Says, item: int | None) -> Answered:
    """Start it at an item; arms a robot that stands by."""
    first = first_of(link) if item is None else item - 1

    def request() -> CommandRequest:
        return link.command(Command.MISSION_START, float(first))

    return insist(link, says, request, beats=False)[0]


def first_of(link: Link) -> int:
    """Where a mission begins when nobody says where, as the wire counts."""
    found = mission_status(link)
    over = found is not None and found.state == MissionState.DONE
    return 0 if over else CURRENT


def command_of(options: argparse.Namespace, link: Link) -> CommandRequest:
    if options.action == "jump":
        return link.command(Command.DO_SET_MISSION_CURRENT, float(options.item - 1))
    if options.action == "abort":
        return link.command(Command.SIDESTEP_ABORT_GOAL)
    return link.command(Command.DO_PAUSE_CONTINUE, float(options.action == "resume"))


def home_of(options: argparse.Namespace) -> Home | None:
    return None if options.home is None else home_at(*options.home)


def read(options: argparse.Namespace) -> Foreign:
    """A file's mission; `-` is standard input, or what a console has put into `typed`."""
    home = home_of(options)
    if options.file != files.DASH:
        return files.read(options.file, home=home, drop=options.drop)
    if getattr(options, "typed", None) is None:
        options.typed = sys.stdin.read(files.LARGEST_BYTES)
    return files.read_text(options.typed, options.file, home=home, drop=options.drop)


def with_files(options: argparse.Namespace, says: Says) -> int:
    """`check` and `convert`."""
    found = read(options)
    row: dict[str, object] = {
        "verb": f"mission {options.action}",
        "ok": True,
        "items": len(found.mission.waypoints),
        "dropped": list(found.dropped),
    }
    text = f"ok, {found.mission}"
    if options.action == "convert":
        if options.out.resolve() == options.file.resolve():
            raise UserError(f"{options.out} would be overwritten: give another name")
        lost = files.write(options.out, found.mission)
        row |= {"file": str(options.out), "lost": list(lost)}
        text = files.written(options.out, found.mission, lost)
    for what in found.dropped:
        says.note(f"left out: {what}")
    says.result(row, text)
    return 0


def upload(link: Link, says: Says, found: Foreign) -> int:
    """The fence first, so that the mission is checked against it; either is taken whole."""
    for what in found.dropped:
        says.note(f"left out: {what}")
    mission = found.mission
    if mission.fence is not None:
        verdict = send_fence(link, mission.fence)
        if not verdict.in_force:
            return tell_verdict(says, "mission upload", link, verdict, "", "the fence: ")
        if not verdict.ok:
            says.note(f"the fence: {verdict.text}")
    items = items_of(mission.waypoints)
    verdict = send(link, Upload(items, MissionType.MISSION, link.clock.now_ns()))
    text = f"ok, the robot has {mission}"
    return tell_verdict(says, "mission upload", link, verdict, text)


def download(link: Link, says: Says, path: Path, home: Home | None) -> int:
    files.ending_of(path)  # refused before anything is asked
    mission = fetched(link)
    if isinstance(mission, Verdict):
        return tell_verdict(says, "mission download", link, mission, "")
    mission = replace(mission, home=home)
    lost = files.write(path, mission)
    row: dict[str, object] = {"verb": "mission download", "ok": True, "file": str(path)}
    row |= {"items": len(mission.waypoints), "lost": list(lost)}
    says.result(row, files.written(path, mission, lost))
    return 0


def listing(link: Link, says: Says) -> int:
    """0 when the robot has a mission, 1 when it has none."""
    mission = fetched(link)
    if isinstance(mission, Verdict):
        return tell_verdict(says, "mission list", link, mission, "")
    rows = [f"{at}  {waypoint}" for at, waypoint in enumerate(mission.waypoints, start=1)]
    rows += [f"fence: {mission.fence}"] if mission.fence else []
    items: list[object] = [asdict(waypoint) for waypoint in mission.waypoints]
    says.result({"verb": "mission list", "ok": True, "waypoints": items}, "\n".join(rows))
    return 0


def fetched(link: Link) -> Mission | Verdict:
    """What the robot has, with its fence, or why there is none."""
    found = fetch(link, MissionType.MISSION)
    fence = fetch(link, MissionType.FENCE)
    if isinstance(found, Verdict):
        return found
    if not found.items:
        return NO_MISSION
    corners = fence.items if isinstance(fence, Downloaded) else ()
    return Mission(waypoints=waypoints_of(found.items), fence=fence_of(corners))
