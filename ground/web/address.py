"""Read the address and the token under which browsers open the ground station."""

import secrets
from pathlib import Path
from typing import Final, NamedTuple

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
