"""What command lines have in common: where a process listens or connects, and odd numbers."""

import argparse
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from protocol.network import Mode, Network

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
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
