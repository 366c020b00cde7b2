"""`mavlink`: test a MAVLink vehicle as a black box, row by row, compare two reports, or watch."""

import argparse
import os
import time
from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ground.app.appearance import add_appearance_options
from ground.app.start import has_screen, run_watch
from ground.commands.command import add_json
from ground.text.output import Output
from ground.user.folders import recordings_folder
from runtime.cli.parsers import add_subcommands
from runtime.errors import UserError
from runtime.files import drafted

if TYPE_CHECKING:
    from vehicle_check.judge import CheckOutcome
    from vehicle_check.networks import VehicleNetwork
    from vehicle_check.vehicle_under_test import AcceptanceRow, CheckOptions

MAX_LOSS: Final = 0.9
PROFILES: Final = ("ardupilot-rover", "ardupilot", "px4", "generic")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions of `mavlink`, with their arguments."""
    actions = add_subcommands(parser, "mavlink")
    check, compare, watch = actions["check"], actions["compare"], actions["watch"]
    text = (
        "endpoint of the vehicle: udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD, "
        "or udpin:HOST:PORT to listen"
    )
    for one in (check, watch):
        one.add_argument("endpoint", metavar="ENDPOINT", help=text)
    text = "rows to test, as in 1-7,19 (default all)"
    check.add_argument("--rows", metavar="ROWS", help=text)
    text = "what the vehicle follows; leaves out the rows of others (default ardupilot-rover)"
    check.add_argument("--as", dest="profile", choices=PROFILES, default=PROFILES[0], help=text)
    text = "end the check after this time; the other rows are not tried (default no limit)"
    check.add_argument("--limit", type=seconds, default=inf, metavar="SECONDS", help=text)
    text = "arm, drive and stop the vehicle: clear the space around it first"
    check.add_argument("--allow-motion", action="store_true", help=text)
    text = "secret key of the link: hexadecimal digits or a passphrase, for rows 51-54"
    check.add_argument("--signing-key", type=Path, metavar="FILE", help=text)
    text = "share of frames to drop in both directions, as in 0.2"
    check.add_argument("--loss", type=loss, default=0.0, metavar="SHARE", help=text)
    text = "seed of the dropped frames (default 1)"
    check.add_argument("--seed", type=int, default=1, metavar="N", help=text)
    check.add_argument("--junit", type=Path, metavar="FILE", help="write a JUnit file, too")
    add_json(check)
    text = "JSON output of `mavlink check`"
    for name in ("before", "after"):
        compare.add_argument(name, type=Path, metavar=name.upper(), help=text)
    add_json(compare)
    text = "system id of the vehicle (default: the first that is heard)"
    watch.add_argument("--system", type=int, default=0, metavar="N", help=text)
    text = "folder of recordings (default: that of Sidestep)"
    watch.add_argument("--recordings", type=Path, metavar="DIR", help=text)
    add_appearance_options(watch)
    watch.set_defaults(json=False)


def seconds(text: str) -> float:
    """Parse a positive number of seconds."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if 0 < value < inf:
        return value
    raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of seconds")


def loss(text: str) -> float:
    """Parse a share of frames."""
    try:
        share = float(text)
    except ValueError:
        share = -1.0
    if 0 <= share <= MAX_LOSS:
        return share
    raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to {MAX_LOSS:g}")


def run(options: argparse.Namespace, output: Output) -> int:
    """Judge the vehicle, or compare; return 0 if no row fails or has become worse, else 1."""
    runs = {"check": check, "compare": compare, "watch": watch}
    return runs[options.action](options, output)


def watch(options: argparse.Namespace, output: Output) -> int:
    """Show the vehicle until the user leaves."""
    from vehicle_check import networks

    if not has_screen():
        raise UserError("mavlink watch needs a terminal: `mavlink check --json` needs none")
    folder = options.recordings or recordings_folder()
    return run_watch(options, networks.network_of(options.endpoint), options.system, folder)


def compare(options: argparse.Namespace, output: Output) -> int:
    """Compare two reports; return 1 if a row fails that did not fail before."""
    from vehicle_check import comparison

    before, after = (comparison.read_report(path) for path in (options.before, options.after))
    found = comparison.changes(before, after)
    same = len(after.rows) - sum(one.after != comparison.ABSENT for one in found)
    result = comparison.as_dict(found, same=same)
    output.result(result, comparison.as_text(found, same=same))
    return 0 if result["ok"] else 1


def check(options: argparse.Namespace, output: Output) -> int:
    """Judge the vehicle; return 1 if a row fails."""
    from vehicle_check import judge, networks
    from vehicle_check.mavlink_frames import read_key
    from vehicle_check.vehicle_under_test import CheckOptions, VehicleProfile

    profile = VehicleProfile(options.profile)
    if options.allow_motion and profile is not VehicleProfile.ROVER:
        raise UserError(f"--allow-motion drives a Rover of ArduPilot: it is not for --as {profile}")

    chosen = chosen_rows(judge.rows(), options.rows)
    key = None if options.signing_key is None else read_key(options.signing_key)
    if options.junit is not None:
        expect_writable(options.junit)
    choices = CheckOptions(
        options.allow_motion, key, options.loss, options.seed, time.time(), options.limit, profile
    )
    outcome = judged_over(networks.network_of(options.endpoint), choices, chosen, output)
    output.result(judge.as_dict(options.endpoint, outcome, profile), judge.as_text(outcome))
    if options.junit is not None:
        write(options.junit, judge.as_junit(options.endpoint, outcome.rows))
    return 0 if judge.is_good(outcome.rows) else 1


def expect_writable(path: Path) -> None:
    """Raise UserError before the check begins if its file could not be written after it."""
    if path.is_dir():
        raise UserError(f"--junit {path}: is a folder, give a file in it")
    if not path.parent.is_dir():
        raise UserError(f"--junit {path}: no such folder")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise UserError(f"--junit {path}: cannot be written")


def write(path: Path, data: bytes) -> None:
    """Write the file; UserError if that fails."""
    try:
        with drafted(path) as draft:
            draft.write_bytes(data)
    except OSError as error:
        raise UserError(f"--junit {path}: {error.strerror or error}") from error


def judged_over(
    network: "VehicleNetwork",
    choices: "CheckOptions",
    rows: "Sequence[AcceptanceRow]",
    output: Output,
) -> "CheckOutcome":
    """Judge over a network, with a live line in a terminal; close the network.

    An interrupted check notes what of the vehicle it has put back.
    """
    from ground.text.wording import Part
    from vehicle_check.judge import judge

    def progress(text: str) -> None:
        if output.live:
            output.line([Part(text)])

    try:
        return judge(network, choices, rows, progress)
    except KeyboardInterrupt as error:
        for words in getattr(error, "__notes__", ()):
            output.note(words)
        raise
    finally:
        network.close()


def chosen_rows(table: "Mapping[int, AcceptanceRow]", text: str | None) -> "list[AcceptanceRow]":
    """Return the rows that a text such as 1-7,19 names; UserError if it is none."""
    if text is None:
        return list(table.values())
    numbers: set[int] = set()
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        if not (low.isdecimal() and (not dash or high.isdecimal())):
            raise UserError(f"--rows {text!r}: {part!r} is not a row or a range, as in 1-7,19")
        numbers |= set(range(int(low), int(high or low) + 1)) & set(range(1, 1000))
    unknown = sorted(numbers - set(table))
    if unknown or not numbers:
        raise UserError(f"--rows {text!r}: rows are 1-{max(table)}")
    return [row for number, row in table.items() if number in numbers]
