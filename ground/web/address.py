"""Where the browser finds the ground station, and the token that it must bring."""

import secrets
from pathlib import Path
from typing import Final, NamedTuple

from runtime.errors import UserError

USUAL_HOST: Final = "127.0.0.1"
USUAL_PORT: Final = 8770
TOKEN_BYTES: Final = 18
LEAST_LETTERS: Final = 16
LOOPBACK: Final = frozenset({"127.0.0.1", "::1", "localhost"})


class Address(NamedTuple):
    host: str
    port: int

    @property
    def local(self) -> bool:
        """Whether nobody but this machine can reach it."""
        return self.host in LOOPBACK

    def url(self, token: str) -> str:
        """What to open: with the token, which the first answer takes out of the address again."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/?token={token}"


def address_of(text: str) -> Address:
    """HOST:PORT, PORT or HOST; what is left out is as usual. UserError says what is wrong."""
    host, _, port = text.strip().rpartition(":") if ":" in text else ("", "", text.strip())
    if port and not (port.isascii() and port.isdigit()):
        host, port = text.strip(), ""
    number = int(port[:6]) if port else USUAL_PORT
    if not 0 < number < 65536:
        raise UserError(f"--web {text}: a port is a number from 1 to 65535")
    host = host.strip("[]") or USUAL_HOST
    if any(letter.isspace() or letter in "/?#@" for letter in host):
        raise UserError(f"--web {text}: write HOST:PORT, as in {USUAL_HOST}:{USUAL_PORT}")
    return Address(host, number)


def token_of(file: str | None) -> str:
    """The token in a file, or a new one that nobody can guess."""
    if file is None:
        return secrets.token_urlsafe(TOKEN_BYTES)
    try:
        token = Path(file).read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "not plain ASCII"
        raise UserError(f"--token-file {file}: {why}") from error
    if len(token) < LEAST_LETTERS or not all(one.isalnum() or one in "-_" for one in token):
        raise UserError(
            f"--token-file {file}: a token has at least {LEAST_LETTERS} letters, digits, - or _"
        )
    return token
