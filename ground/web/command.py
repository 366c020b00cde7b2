"""`sidestep ground --web`: serves the ground station until it is told to stop."""

import argparse
import os
import shlex
import socket
from contextlib import closing
from pathlib import Path
from typing import Final, Protocol

from ground.launch.child_command import command
from ground.text.output import Output
from ground.web.address import USUAL_HOST, USUAL_PORT, Address, address_of, token_of
from runtime.errors import UserError

PASSED_ON: Final = ("connect", "id", "config", "record", "theme", "hz", "keys")
SWITCHES: Final = ("no_record", "ascii")
LACKING: Final = "--web needs the extra `web`: pip install 'sidestep[web]'"


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--web",
        nargs="?",
        const="",
        metavar="HOST:PORT",
        help=f"in a browser instead of this terminal ({USUAL_HOST}:{USUAL_PORT})",
    )
    parser.add_argument(
        "--shown",
        metavar="HOST:PORT",
        help="where browsers find it, when that is somewhere else, as with a container's port",
    )
    parser.add_argument(
        "--token-file", metavar="FILE", help="the token that a browser must bring; else a new one"
    )


class WebOptions(Protocol):
    """The options of a ground station that is shown in a browser."""

    web: str
    shown: str | None
    token_file: str | None
    connect: str | None
    id: str | None
    config: str | None
    record: str | None
    no_record: bool
    theme: str | None
    ascii: bool
    hz: float
    keys: Path | None


def serve(options: WebOptions, says: Output) -> int:
    """Until SIGINT or SIGTERM: each browser gets an app with the same options.

    Raises UserError when the address is taken or the library is not there.
    """
    address, token = address_of(options.web), token_of(options.token_file)
    shown = address if options.shown is None else address_of(options.shown)
    try:
        from ground.web.server import WebServer
    except ImportError as error:
        raise UserError(LACKING) from error
    refuse_taken(address)

    def ready() -> None:
        says.note(f"open {shown.url(token)}")
        if not shown.local:
            says.note(
                "anybody who can reach this address and has the token drives the robot, and plain"
                " HTTP shows the token to the network: put TLS in front"
            )

    # exec: the shell that textual-serve starts must not stand between us and the app.
    line = "exec " + shlex.join(command(words_of(options), os.getpid()))
    WebServer(line, address, token, ready).serve()
    says.note("ground station ends")
    return 0


def words_of(options: WebOptions) -> list[str]:
    """The verb and its options, as the app of a browser is to be started."""
    words = ["ground"]
    for name in PASSED_ON:
        value = getattr(options, name)
        if value is not None:
            words += [f"--{name}", str(value)]
    return words + [f"--{name.replace('_', '-')}" for name in SWITCHES if getattr(options, name)]


def refuse_taken(address: Address) -> None:
    """UserError when nobody can listen there."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
        family, kind, protocol, _, place = found[0]
        with closing(socket.socket(family, kind, protocol)) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(place)
    except OSError as error:
        raise UserError(
            f"--web {address.host}:{address.port}: {error.strerror}; choose another port"
        ) from error
