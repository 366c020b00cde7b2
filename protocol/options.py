"""Command-line options shared by several programs: endpoints, numbers and parameters."""

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import inf, isfinite
from typing import Final

from protocol.bus.network import LOCKED, Mode, Network
from runtime.errors import not_a_number

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
LOCKED_ENDPOINT: Final = f"{LOCKED}127.0.0.1:7447"
CONFIG_HELP: Final = (
    "TOML file for ground, robot and plant: robot = NAME; [network] with listen (endpoint of the"
    " robot), connect (endpoint that the others dial; default: listen; with mode = 'client' the"
    " robot dials it, too), prefix; [network.tls] with ca, certificate, key (made by"
    " `sidestep keys`); [parameters] of the robot"
)
ARGPARSE_TAKES: Final = re.compile(r"-\d+\Z|-\d*\.\d+\Z")


def numbers_kept(words: Iterable[str]) -> list[str]:
    """Return the words, with a blank before negative numbers such as -1e3, -5. and -inf.

    argparse would read those as options; with the blank it reads them as values, as float() does.
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
    """Parse a number; raise ArgumentTypeError for NaN, infinity and anything else."""
    text = text.strip()
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(not_a_number(text)) from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def above_zero(high: float = inf) -> Callable[[str], float]:
    """Return a parser of numbers above 0 and at most `high`."""

    def read(text: str) -> float:
        value = finite(text)
        if not 0.0 < value <= high:
            limits = f"above 0 and at most {high:g}" if high < inf else "above 0"
            raise argparse.ArgumentTypeError(f"{text.strip()} is not {limits}")
        return value

    return read


def up_to(high: float) -> Callable[[str], float]:
    """Return a parser of numbers from 0 to `high`, both included."""

    def read(text: str) -> float:
        value = finite(text)
        if not 0.0 <= value <= high:
            raise argparse.ArgumentTypeError(f"{text.strip()} is not within 0 to {high:g}")
        return value

    return read


def whole(low: int, high: float = inf) -> Callable[[str], int]:
    """Return a parser of whole numbers from `low` to `high`, both included."""

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
    parser: argparse.ArgumentParser, help_text: str = "set a parameter of the robot; repeatable"
) -> None:
    """Add `--param NAME=VALUE`, repeatable; `param` is a list of names with their values."""
    parser.add_argument(
        "--param",
        type=_assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help=help_text,
    )


def _assignment(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r}: write NAME=VALUE, as in d_obs_m=0.4")
    return name, finite(value)


def add_network_options(parser: argparse.ArgumentParser) -> None:
    """Add `--listen`, `--connect` and `--config`."""
    parser.add_argument(
        "--listen", metavar="ENDPOINT", action="append", help="accept connections on this endpoint"
    )
    parser.add_argument(
        "--connect", metavar="ENDPOINT", action="append", help="connect to this endpoint"
    )
    parser.add_argument("--config", metavar="FILE", help=CONFIG_HELP)


def network_of(
    arguments: argparse.Namespace, configured: Network | None, *, listens: bool
) -> Network:
    """Return the network of the command line, else of the file, else the default endpoint.

    `listens`: whether this process listens by default. Raises EndpointError.
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
    """Return the endpoints to listen on and to dial; one `[network]` serves both sides."""
    if network.mode == "client":
        return (), network.connect
    if not listens:
        return (), dialled(network)
    if network.listen or not network.connect:
        return network.listen or (usual_endpoint(network),), ()
    return (), network.connect


def dialled(network: Network) -> tuple[str, ...]:
    """Return the endpoints to dial: by default those on which the other side listens."""
    return network.connect or network.listen or (usual_endpoint(network),)


def usual_endpoint(network: Network) -> str:
    """Return the default endpoint on this machine, with TLS if it is configured."""
    return LOCKED_ENDPOINT if network.tls else DEFAULT_ENDPOINT
