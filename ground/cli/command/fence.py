"""`fence`: the circle or polygon the robot must not leave, and may not be sent out of."""

import argparse
from pathlib import Path
from typing import Final

from ground.client.connection import add_common, common_of, positive, within
from ground.client.link import Link, linked
from ground.missions.files import ENDINGS, read_fence
from ground.missions.mission import FARTHEST_M, Circle, Fence, Polygon
from ground.missions.outline import fault_of
from ground.missions.transfer import Clear, Verdict
from ground.missions.transport import fetch, send, send_fence, tell_verdict
from ground.missions.wire import fence_of
from ground.text.output import Says
from protocol.options import finite
from protocol.wire.enums import MissionType
from runtime.errors import UserError

SETTING: Final = ("circle", "polygon")


def arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True, metavar="circle|polygon|off|show")
    circling = actions.add_parser("circle", help="stay within R metres of X Y")
    circling.add_argument("x", type=finite, metavar="X", help="metres")
    circling.add_argument("y", type=finite, metavar="Y", help="metres")
    circling.add_argument("radius", type=positive, metavar="R", help="metres")
    outlining = actions.add_parser("polygon", help="stay inside of these corners")
    outlining.add_argument(
        "corners", nargs="+", metavar="FILE", help="a mission file with a fence, or X Y X Y X Y ..."
    )
    clearing = actions.add_parser("off", help="take the fence away")
    showing = actions.add_parser("show", help="which fence the robot has")
    for action in (circling, outlining, clearing, showing):
        add_common(action)


def run(options: argparse.Namespace, says: Says) -> int:
    if options.action in SETTING:
        fence_in(options)  # what cannot be a fence is refused before anybody is dialled
    with linked(common_of(options)) as link:
        return act(options, link, says)


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    if options.action == "show":
        return show(link, says)
    if options.action == "off":
        verdict = send(link, Clear(MissionType.FENCE, link.clock.now_ns()))
        return tell_verdict(says, "fence off", link, verdict, "ok, there is no fence")
    fence = fence_in(options)
    verdict = send_fence(link, fence)
    return tell_verdict(says, f"fence {options.action}", link, verdict, f"ok, {fence}")


def fence_in(options: argparse.Namespace) -> Fence:
    """What was typed; UserError when it is no fence."""
    if options.action == "circle":
        for name, value in (("x", options.x), ("y", options.y), ("radius", options.radius)):
            within(value, -FARTHEST_M, FARTHEST_M, name, "m")
        return Circle(x_m=options.x, y_m=options.y, radius_m=options.radius)
    first: str = options.corners[0]
    if len(options.corners) == 1 and first.lower().endswith(ENDINGS):
        return read_fence(Path(first))
    return outlined(options.corners)


def outlined(words: list[str]) -> Polygon:
    """X Y X Y ... as corners."""
    try:
        numbers = [finite(word) for word in words]
    except argparse.ArgumentTypeError as error:
        raise UserError(f"{error}; a fence is X Y X Y X Y ..., or a mission file") from error
    if len(numbers) % 2:
        raise UserError(f"{len(numbers)} numbers are no corners: X Y for each")
    for value in numbers:
        within(value, -FARTHEST_M, FARTHEST_M, "corner", "m")
    polygon = Polygon(corners=tuple(zip(numbers[::2], numbers[1::2], strict=True)))
    if fault := fault_of(polygon.corners):
        raise UserError(f"this is no fence: {fault}; put the corners in order, round the place")
    return polygon


def show(link: Link, says: Says) -> int:
    found = fetch(link, MissionType.FENCE)
    if isinstance(found, Verdict):
        return tell_verdict(says, "fence show", link, found, "no fence")
    fence = fence_of(found.items)
    row: dict[str, object] = {"verb": "fence show", "robot": link.robot, "ok": True, "fence": None}
    if isinstance(fence, Circle):
        row["fence"] = {"x_m": fence.x_m, "y_m": fence.y_m, "radius_m": fence.radius_m}
    elif fence is not None:
        row["fence"] = {"corners": [list(corner) for corner in fence.corners]}
    says.result(row, "no fence" if fence is None else in_words(fence))
    return 0


def in_words(fence: Fence) -> str:
    """With all its corners."""
    if isinstance(fence, Circle):
        return str(fence)
    return f"{fence}: {' '.join(f'({x:g}, {y:g})' for x, y in fence.corners)}"
