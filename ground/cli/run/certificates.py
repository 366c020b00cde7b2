"""`keys`: create, renew, revoke and check certificates of a bus with TLS; manage signing keys."""

import argparse
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from ground.cli.run import signing_keys
from ground.commands.command import add_json
from ground.text.output import Output
from protocol.bus.network import check_operators
from protocol.bus.rights import ROBOT, ROUTER
from protocol.options import whole
from protocol.topics import robot_name
from runtime.cli.parsers import add_subcommands
from runtime.errors import UserError

MISSING_LIBRARY: Final = "keys needs the package cryptography: pip install 'sidestep[keys]'"
DEFAULT_DAYS: Final = 365
MOST_DAYS: Final = 3650
CLOCK_TOLERANCE: Final = timedelta(minutes=5)
"""Certificates are valid from this long ago, because clocks differ."""
FOLDER_HELP: Final = "folder created by `keys new`"
NAME_HELP: Final = "name of a certificate, as in ground-ada or robot-r2"

HOST: Final = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(?<!-)(\.(?!-)[A-Za-z0-9-]{1,63}(?<!-))*\Z")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions of `keys`, with their arguments."""
    actions = add_subcommands(parser, "keys")
    days = whole(1, MOST_DAYS)
    new, renew = actions["new"], actions["renew"]
    add_new(new)
    renew.add_argument("folder", type=Path, metavar="DIR", help="folder with an authority.key")
    renew.add_argument("names", nargs="+", metavar="NAME", help=NAME_HELP)
    revoke = actions["revoke"]
    revoke.add_argument("folder", type=Path, metavar="DIR", help=FOLDER_HELP)
    revoke.add_argument("names", nargs="+", metavar="NAME", help=NAME_HELP)
    for name in ("check", "stops"):
        actions[name].add_argument("folder", type=Path, metavar="DIR", help=FOLDER_HELP)
    for action in (new, renew):
        text = f"days of validity (default {DEFAULT_DAYS})"
        action.add_argument("--days", type=days, default=DEFAULT_DAYS, metavar="N", help=text)
    signing_keys.arguments(actions["signing"])
    for action in actions.values():
        add_json(action)


def add_new(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `keys new`, except the validity."""
    text = "folder to create; no file is overwritten"
    parser.add_argument("folder", type=Path, metavar="DIR", help=text)
    text = "names of the robots (default r1)"
    parser.add_argument("--robots", nargs="+", default=["r1"], metavar="NAME", help=text)
    text = "operators with a certificate of their own, ground-NAME, which reserves the name"
    parser.add_argument("--operators", nargs="+", default=[], metavar="NAME", help=text)
    text = (
        "more names and addresses of the router (and of the robot, if there is only one);"
        " ROBOT=HOST for a robot that others connect to"
    )
    parser.add_argument("--host", nargs="+", type=place, default=[], metavar="HOST", help=text)
    text = (
        "make the authority valid for N days and keep its key in authority.key, for `keys renew`;"
        " move that file to a safe place"
    )
    parser.add_argument("--keep-authority", type=whole(1, MOST_DAYS), metavar="N", help=text)


def place(text: str) -> tuple[str, str]:
    """Parse ROBOT=HOST or HOST; the robot's name is empty for the router."""
    robot, _, name = text.rpartition("=")
    return robot, host(name)


def host(text: str) -> str:
    """Parse a host name or an address, as a certificate holds it."""
    text = text.strip()
    try:
        return str(ip_address(text))
    except ValueError:
        if HOST.match(text) and len(text) < 254:
            return text
    raise argparse.ArgumentTypeError(f"{text!r} is neither a host name nor an address")


def run(options: argparse.Namespace, output: Output) -> int:
    """Run the action; return 0 for success, 1 if a certificate is not valid."""
    if options.action == "signing":
        return signing_keys.run(options, output)
    require_library()
    runs = {
        "new": run_new,
        "renew": run_renew,
        "revoke": run_revoke,
        "check": run_check,
        "stops": run_stops,
    }
    return runs[options.action](options, output)


def require_library() -> None:
    """Raise UserError with the package to install if `cryptography` is missing."""
    try:
        import cryptography  # noqa: F401
    except ModuleNotFoundError as error:
        raise UserError(MISSING_LIBRARY) from error


def run_new(options: argparse.Namespace, output: Output) -> int:
    """Create a folder of certificates; UserError for duplicate robots or an unknown host."""
    from ground.certificates import make

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
    roles = make(options.folder, robots, hosts, now - CLOCK_TOLERANCE, until, operators, authority)
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
    """Create new certificates and keys with a kept authority."""
    from ground.certificates import renew

    now = datetime.now(UTC)
    wanted = now + timedelta(days=options.days)
    until = renew(options.folder, options.names, now - CLOCK_TOLERANCE, wanted)
    row: dict[str, object] = {
        "ok": True,
        "folder": str(options.folder),
        "roles": options.names,
        "until": until.isoformat(timespec="seconds"),
    }
    output.result(
        row, f"{options.folder}: renewed {', '.join(options.names)}, until {until:%Y-%m-%d}"
    )
    return 0


def run_revoke(options: argparse.Namespace, output: Output) -> int:
    """Add certificates to the revoked ones in all configurations of a folder."""
    from ground.certificates import revoke

    found = revoke(options.folder, options.names)
    use = "copy the .toml files to the processes that use them, and restart these processes"
    row: dict[str, object] = {"ok": True, "folder": str(options.folder), "revoked": found}
    output.result(row, f"{options.folder}: revoked: {', '.join(found)}\n  {use}")
    return 0


def run_stops(options: argparse.Namespace, output: Output) -> int:
    """Add the secrets of the stop datagram to a folder of an older version."""
    from ground.certificates import add_stop_secrets

    roles = add_stop_secrets(options.folder)
    use = "copy each .stops file to where the .key of the same name is, and restart the robots"
    row: dict[str, object] = {"ok": True, "folder": str(options.folder), "roles": roles}
    output.result(row, f"{options.folder}: stop secrets of {', '.join(roles)}\n  {use}")
    return 0


def hosts_of(places: Sequence[tuple[str, str]], robots: Sequence[str]) -> dict[str, list[str]]:
    """Return the hosts of each role; UserError names a robot that is not in --robots."""
    found: dict[str, list[str]] = {}
    for robot, name in places:
        if robot and robot not in robots:
            raise UserError(f"--host {robot}={name}: --robots has no {robot}")
        router = [ROUTER] if len(robots) > 1 else [ROUTER, ROBOT + robots[0]]
        for role in [ROBOT + robot] if robot else router:
            found.setdefault(role, []).append(name)
    return found


def run_check(options: argparse.Namespace, output: Output) -> int:
    """Check all certificates of a folder; return 1 if one is not valid."""
    from ground.certificates import check
    from protocol.bus.certificate import EXPIRES_SOON

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
    soon = [
        f"W {one.file} expires within {EXPIRES_SOON.days} days" for one in all_checked if one.soon
    ]
    output.result(found, "\n".join([*(one.line() for one in all_checked), *soon]))
    return 0 if good else 1
