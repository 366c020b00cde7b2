"""`keys`: makes the certificates of a locked bus, and says what they are good for."""

import argparse
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from ground.grammar.words import add_json
from ground.text.output import Output
from protocol.bus.network import check_operators
from protocol.bus.tls.access import ROBOT, ROUTER
from protocol.options import whole
from protocol.topics import robot_name
from runtime.errors import UserError

LACKING: Final = "keys needs the library cryptography: pip install 'sidestep[keys]'"
USUAL_DAYS: Final = 365
MOST_DAYS: Final = 3650
EARLY: Final = timedelta(minutes=5)
"""Valid since then: clocks differ."""

HOST: Final = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(?<!-)(\.(?!-)[A-Za-z0-9-]{1,63}(?<!-))*\Z")


def arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    new = actions.add_parser("new", help="an authority, and certificate, key and config per role")
    new.add_argument("folder", type=Path, metavar="DIR", help="to be made; nothing is overwritten")
    new.add_argument(
        "--robots", nargs="+", default=["r1"], metavar="NAME", help="that there will be (r1)"
    )
    new.add_argument(
        "--operators",
        nargs="+",
        default=[],
        metavar="NAME",
        help="with a certificate of their own, ground-NAME: nobody else commands under these names",
    )
    new.add_argument(
        "--host",
        nargs="+",
        type=place,
        default=[],
        metavar="HOST",
        help="more names and addresses of the router (and of the robot, if there is one only); "
        "ROBOT=HOST for a robot that is dialled",
    )
    new.add_argument(
        "--days",
        type=whole(1, MOST_DAYS),
        default=USUAL_DAYS,
        metavar="N",
        help=f"for which they are valid ({USUAL_DAYS})",
    )
    new.add_argument(
        "--keep-authority",
        type=whole(1, MOST_DAYS),
        metavar="N",
        help="valid for N days, with its key in authority.key, for `keys renew`: move that to a "
        "safe place",
    )
    renew = actions.add_parser("renew", help="new certificates and keys from a kept authority")
    renew.add_argument("folder", type=Path, metavar="DIR", help="with its authority.key")
    renew.add_argument("names", nargs="+", metavar="NAME", help="as in ground-ada or robot-r2")
    renew.add_argument("--days", type=whole(1, MOST_DAYS), default=USUAL_DAYS, metavar="N")
    revoke = actions.add_parser("revoke", help="have a certificate refused, though it is valid")
    revoke.add_argument("folder", type=Path, metavar="DIR", help="as `keys new` made it")
    revoke.add_argument("names", nargs="+", metavar="NAME", help="as in ground-ada or robot-r2")
    check = actions.add_parser("check", help="until when each is valid, and what is wrong")
    check.add_argument("folder", type=Path, metavar="DIR", help="as `keys new` made it")
    for action in (new, renew, revoke, check):
        add_json(action)


def place(text: str) -> tuple[str, str]:
    """A robot's name, empty for the router, and a host."""
    robot, _, name = text.rpartition("=")
    return robot, host(name)


def host(text: str) -> str:
    """A host name or an address, as a certificate has it."""
    text = text.strip()
    try:
        return str(ip_address(text))
    except ValueError:
        if HOST.match(text) and len(text) < 254:
            return text
    raise argparse.ArgumentTypeError(f"{text!r} is neither a host name nor an address")


def run(options: argparse.Namespace, output: Output) -> int:
    """0 when made or good, 1 when something is wrong with a certificate."""
    require_library()
    runs = {"new": run_new, "renew": run_renew, "revoke": run_revoke, "check": run_check}
    return runs[options.action](options, output)


def require_library() -> None:
    """UserError says what to install where it is missing."""
    try:
        import cryptography  # noqa: F401
    except ModuleNotFoundError as error:
        raise UserError(LACKING) from error


def run_new(options: argparse.Namespace, output: Output) -> int:
    from ground.certificates.folder import make

    robots = [robot_name(name) for name in options.robots]
    if len(set(robots)) < len(robots):
        raise UserError(f"--robots {' '.join(robots)}: each robot needs a name of its own")
    operators = [name for words in options.operators for name in words.split(",") if name]
    check_operators(operators)
    now = datetime.now(UTC)
    until = now + timedelta(days=options.days)
    hosts, authority = hosts_of(options.host, robots), None
    if options.keep_authority:
        authority = max(until, now + timedelta(days=options.keep_authority))
    roles = make(options.folder, robots, hosts, now - EARLY, until, operators, authority)
    found: dict[str, object] = {
        "ok": True,
        "folder": str(options.folder),
        "roles": roles,
        "until": until.isoformat(timespec="seconds"),
    }
    use = f"use them with --config, as in: sidestep ground --config {options.folder}/ground.toml"
    made = f"{options.folder}: {', '.join(roles)}, until {until:%Y-%m-%d}"
    output.result(found, f"{made}\n  {use}")
    return 0


def run_renew(options: argparse.Namespace, output: Output) -> int:
    from ground.certificates.folder import renew

    now = datetime.now(UTC)
    wanted = now + timedelta(days=options.days)
    until = renew(options.folder, options.names, now - EARLY, wanted)
    row: dict[str, object] = {
        "ok": True,
        "folder": str(options.folder),
        "roles": options.names,
        "until": until.isoformat(timespec="seconds"),
    }
    output.result(row, f"{options.folder}: {', '.join(options.names)} anew, until {until:%Y-%m-%d}")
    return 0


def run_revoke(options: argparse.Namespace, output: Output) -> int:
    from ground.certificates.folder import revoke

    found = revoke(options.folder, options.names)
    use = "give its .toml to each process that listens or dials, and start these again"
    row: dict[str, object] = {"ok": True, "folder": str(options.folder), "revoked": found}
    output.result(row, f"{options.folder}: revoked are {', '.join(found)}\n  {use}")
    return 0


def hosts_of(places: Sequence[tuple[str, str]], robots: Sequence[str]) -> dict[str, list[str]]:
    """The hosts of each role. UserError names a robot that there is not."""
    found: dict[str, list[str]] = {}
    for robot, name in places:
        if robot and robot not in robots:
            raise UserError(f"--host {robot}={name}: --robots has no {robot}")
        router = [ROUTER] if len(robots) > 1 else [ROUTER, ROBOT + robots[0]]
        for role in [ROBOT + robot] if robot else router:
            found.setdefault(role, []).append(name)
    return found


def run_check(options: argparse.Namespace, output: Output) -> int:
    from ground.certificates.check import SOON, check

    all_checked = check(options.folder, datetime.now(UTC))
    good = not any(one.wrong for one in all_checked)
    found: dict[str, object] = {
        "ok": good,
        "certificates": [
            {
                "name": one.name,
                "file": one.file,
                "until": one.until.isoformat(timespec="seconds"),
                "wrong": list(one.wrong),
                "soon": one.soon,
            }
            for one in all_checked
        ],
    }
    soon = [f"W {one.file} expires within {SOON.days} days" for one in all_checked if one.soon]
    output.result(found, "\n".join([*(one.line() for one in all_checked), *soon]))
    return 0 if good else 1
