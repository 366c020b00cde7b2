"""Serve the ground station to browsers (`sidestep ground --web`) until SIGINT or SIGTERM.

The server needs the extra `web`, so it is imported only when it is started.
"""

import argparse
import os
import secrets
import shlex
import socket
from contextlib import closing
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from ground.launch.child_command import command
from ground.text.output import Output
from runtime.errors import UserError
from runtime.files import bytes_in

DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_PORT: Final = 8770
TOKEN_BYTES: Final = 18
MIN_TOKEN_LENGTH: Final = 16
MAX_BYTES: Final = 4096
LOOPBACK: Final = frozenset({"127.0.0.1", "::1", "localhost"})


class Address(NamedTuple):
    """Host and port on which the server listens."""

    host: str
    port: int

    @property
    def local(self) -> bool:
        """True when only this machine can reach the address."""
        return self.host in LOOPBACK

    def url(self, token: str) -> str:
        """Return the address to open, with the token; the first response removes the token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/?token={token}"


def address_of(text: str) -> Address:
    """Read HOST:PORT, PORT or HOST, completed with the defaults.

    Raise UserError when the text is none of these.
    """
    host, _, port = text.strip().rpartition(":") if ":" in text else ("", "", text.strip())
    if port and not (port.isascii() and port.isdigit()):
        host, port = text.strip(), ""
    number = int(port[:6]) if port else DEFAULT_PORT
    if not 0 < number < 65536:
        raise UserError(f"--web {text}: the port must be a number from 1 to 65535")
    host = host.strip("[]") or DEFAULT_HOST
    if any(letter.isspace() or letter in "/?#@" for letter in host):
        raise UserError(f"--web {text}: not HOST:PORT, such as {DEFAULT_HOST}:{DEFAULT_PORT}")
    return Address(host, number)


def token_of(file: str | None) -> str:
    """Return the token from a file, or a new random one.

    Raise UserError when the file cannot be read or the token is too short.
    """
    if file is None:
        return secrets.token_urlsafe(TOKEN_BYTES)
    try:
        token = bytes_in(Path(file), MAX_BYTES).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not plain ASCII"
        raise UserError(f"--token-file {file}: {reason}: write a token into a file") from error
    if len(token) < MIN_TOKEN_LENGTH or not all(one.isalnum() or one in "-_" for one in token):
        raise UserError(
            f"--token-file {file}: a token must have at least {MIN_TOKEN_LENGTH} characters,"
            " each a letter, a digit, - or _"
        )
    return token


PASSED_ON: Final = ("connect", "run", "context", "id", "config", "record", "theme", "hz", "keys")
SWITCHES: Final = ("no_record", "ascii", "quiet_bell")
LACKING: Final = "--web needs the extra `web`: pip install 'sidestep[web]'"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a ground station that is served to browsers."""
    parser.add_argument(
        "--web",
        nargs="?",
        const="",
        metavar="HOST:PORT",
        help=f"serve browsers instead of this terminal (default {DEFAULT_HOST}:{DEFAULT_PORT})",
    )
    parser.add_argument(
        "--shown",
        metavar="HOST:PORT",
        help="the address that browsers use when it differs, as with the port of a container",
    )
    parser.add_argument(
        "--token-file", metavar="FILE", help="read the token from a file (default a new random one)"
    )


class WebOptions(Protocol):
    """The options of a ground station that is served to browsers."""

    web: str
    shown: str | None
    token_file: str | None
    connect: str | None
    run: str | None
    context: str | None
    id: str | None
    config: str | None
    record: str | None
    no_record: bool
    theme: str | None
    ascii: bool
    quiet_bell: bool
    hz: float | None
    keys: Path | None


def serve(options: WebOptions, output: Output) -> int:
    """Serve until SIGINT or SIGTERM; each browser gets an app with the same options.

    Raise UserError when the address is in use or the extra `web` is not installed.
    """
    address, token = address_of(options.web), token_of(options.token_file)
    shown = address if options.shown is None else address_of(options.shown)
    try:
        from ground.web_server import WebServer
    except ImportError as error:
        raise UserError(LACKING) from error
    refuse_taken(address)

    def ready() -> None:
        output.note(f"open {shown.url(token)}")
        if not shown.local:
            output.note(
                "every client that reaches this address with the token can drive the robot, and"
                " plain HTTP shows the token to the network: put a TLS proxy in front"
            )

    # exec replaces the shell that textual-serve starts, so that signals reach the app.
    line = "exec " + shlex.join(command(words_of(options), os.getpid()))
    WebServer(line, address.host, address.port, token, ready).serve()
    output.note("ground station ends")
    return 0


def words_of(options: WebOptions) -> list[str]:
    """Return the command line with which the app of each browser is started."""
    words = ["ground"]
    for name in PASSED_ON:
        value = getattr(options, name)
        if value is not None:
            words += [f"--{name}", str(value)]
    return words + [f"--{name.replace('_', '-')}" for name in SWITCHES if getattr(options, name)]


def refuse_taken(address: Address) -> None:
    """Raise UserError when no server can listen at the address."""
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
