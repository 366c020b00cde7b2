"""What command lines have in common: where a process listens or connects, numbers, parameters."""

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import inf, isfinite
from typing import Final

from protocol.bus.network import LOCKED, Mode, Network

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
LOCKED_ENDPOINT: Final = f"{LOCKED}127.0.0.1:7447"
CONFIG_HELP: Final = (
    "TOML, one file for ground, robot and plant: robot = NAME, [network] with listen (where the"
    " robot waits), connect (where the others dial, if not there; everybody, with mode = 'client'),"
    " prefix; [network.tls] with ca, certificate, key (`sidestep keys` makes them); [parameters] of"
    " the robot"
)
ARGPARSE_TAKES: Final = re.compile(r"-\d+\Z|-\d*\.\d+\Z")


def numbers_kept(words: Iterable[str]) -> list[str]:
    """The words, with a blank before negative numbers such as -1e3, -5. and -inf.

    argparse would take those for options; with the blank they are values, as float() reads them.
    """
    return [f" {word}" if _taken_for_option(word) else word for word in words]


def _taken_for_option(word: str) -> bool:
    if not word.startswith("-") or ARGPARSE_TAKES.match(word):
        return False
    try:
        float(word)
    except ValueError:
        return False
    return True


def finite(text: str) -> float:
    """A number that is one: neither NaN nor infinite."""
    text = text.strip()
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def above_zero(high: float = inf) -> Callable[[str], float]:
    """What reads a number above 0 and at most `high`."""

    def read(text: str) -> float:
        value = finite(text)
        if not 0.0 < value <= high:
            limits = f"above 0 and at most {high:g}" if high < inf else "above 0"
            raise argparse.ArgumentTypeError(f"{text.strip()} is not {limits}")
        return value

    return read


def up_to(high: float) -> Callable[[str], float]:
    """What reads a number from 0 to `high`, both included."""

    def read(text: str) -> float:
        value = finite(text)
        if not 0.0 <= value <= high:
            raise argparse.ArgumentTypeError(f"{text.strip()} is not within 0 to {high:g}")
        return value

    return read


def whole(low: int, high: float = inf) -> Callable[[str], int]:
    """What reads a whole number from `low` to `high`, both included."""

    def read(text: str) -> int:
        text = text.strip()
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
        if not low <= value <= high:
            limits = f"within {low} to {high}" if high < inf else f"at least {low}"
            raise argparse.ArgumentTypeError(f"{text} is not {limits}")
        return value

    return read


def add_param_option(
    parser: argparse.ArgumentParser, says: str = "a parameter of the robot, as often as needed"
) -> None:
    """`--param NAME=VALUE`, any number of them: `param` is a list of names with their values."""
    parser.add_argument(
        "--param",
        type=_assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help=says,
    )


def _assignment(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r}: write NAME=VALUE, as in d_obs_m=0.4")
    return name, finite(value)


def add_network_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--listen", metavar="ENDPOINT", action="append", help="wait there for others"
    )
    parser.add_argument(
        "--connect", metavar="ENDPOINT", action="append", help="dial those who wait"
    )
    parser.add_argument("--config", metavar="FILE", help=CONFIG_HELP)


def network_of(
    arguments: argparse.Namespace, configured: Network | None, *, listens: bool
) -> Network:
    """The command line, else the file, else this machine's default endpoint.

    `listens`: the process others dial when nothing is said. Raises BadEndpoint.
    """
    listen: Sequence[str] | None
    connect: Sequence[str] | None
    listen, connect = arguments.listen, arguments.connect
    if listen is None and connect is None:
        if configured is not None and configured.mode == "router":
            return configured
        listen, connect = _from_file(configured or Network(), listens=listens)
    mode: Mode = "client" if connect and not listen else "peer"
    return replace(
        configured or Network(),
        mode=mode,
        listen=tuple(listen or ()),
        connect=tuple(connect or ()),
    )


def _from_file(network: Network, *, listens: bool) -> tuple[Sequence[str], Sequence[str]]:
    """Where to listen and where to dial: one `[network]` for the one that waits and the others."""
    if network.mode == "client":
        return (), network.connect
    if not listens:
        return (), dialled(network)
    if network.listen or not network.connect:
        return network.listen or (usual_endpoint(network),), ()
    return (), network.connect


def dialled(network: Network) -> tuple[str, ...]:
    """Where those dial who do not listen: unless it says where, the place where the other waits."""
    return network.connect or network.listen or (usual_endpoint(network),)


def usual_endpoint(network: Network) -> str:
    """On this machine, locked or not."""
    return LOCKED_ENDPOINT if network.tls else DEFAULT_ENDPOINT
