"""The command-line options that every process on the bus has: where it listens or connects."""

import argparse
from dataclasses import replace
from typing import Final

from protocol.network import Mode, Network

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"


def add_network_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--listen", metavar="ENDPOINT", action="append", help="wait there for others"
    )
    parser.add_argument(
        "--connect", metavar="ENDPOINT", action="append", help="dial those who wait"
    )
    parser.add_argument("--config", metavar="FILE", help="TOML file with a [network] table")


def network_of(
    arguments: argparse.Namespace, configured: Network | None, *, listens: bool
) -> Network:
    """The command line, else the file, else this machine's default endpoint.

    `listens`: the process others dial when nothing is said. Raises BadEndpoint.
    """
    listen, connect = arguments.listen, arguments.connect
    if listen is None and connect is None:
        if configured is not None:
            return configured
        listen, connect = ([DEFAULT_ENDPOINT], None) if listens else (None, [DEFAULT_ENDPOINT])
    mode: Mode = "client" if connect and not listen else "peer"
    return replace(
        configured or Network(),
        mode=mode,
        listen=tuple(listen or ()),
        connect=tuple(connect or ()),
    )
