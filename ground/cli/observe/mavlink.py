"""`mavlink check`: test a MAVLink vehicle as a black box, row by row."""

import argparse
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ground.commands.command import add_json
from ground.text.output import Output
from runtime.cli.parsers import add_subcommands
from runtime.errors import UserError

if TYPE_CHECKING:
    from vehicle_check.ground_stations import VehicleNetwork
    from vehicle_check.judge import CheckOutcome
    from vehicle_check.vehicle_under_test import AcceptanceRow, CheckOptions

MAX_LOSS: Final = 0.9


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions of `mavlink`, with their arguments."""
    check = add_subcommands(parser, "mavlink")["check"]
    text = "endpoint of the vehicle: udpout:HOST:PORT, tcp:HOST:PORT, or udpin:HOST:PORT to listen"
    check.add_argument("endpoint", metavar="ENDPOINT", help=text)
    text = "rows to test, as in 1-7,19 (default all)"
    check.add_argument("--rows", metavar="ROWS", help=text)
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
    """Judge the vehicle; return 0 if no row fails, else 1."""
    from vehicle_check import judge
    from vehicle_check.ground_stations import SocketNetwork
    from vehicle_check.mavlink_frames import read_key
    from vehicle_check.vehicle_under_test import CheckOptions

    chosen = chosen_rows(judge.rows(), options.rows)
    key = None if options.signing_key is None else read_key(options.signing_key)
    if options.junit is not None:
        expect_writable(options.junit)
    choices = CheckOptions(options.allow_motion, key, options.loss, options.seed, time.time())
    outcome = judged_over(SocketNetwork(options.endpoint), choices, chosen, output)
    output.result(judge.as_dict(options.endpoint, outcome), judge.as_text(outcome))
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
        path.write_bytes(data)
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
