"""Errors by origin: LocalError (a defect), UserError (the user), RemoteError (the peer).

And the exit codes of all programs, which docs/reference/exit-codes.md explains.
"""

import re
from typing import Final

EXIT_OK: Final = 0
EXIT_FAILURE: Final = 1
EXIT_USAGE: Final = 2
EXIT_SIGNAL: Final = 128
"""Plus the number of the signal."""
EXIT_INTERRUPTED: Final = 130


class LocalError(Exception):
    """A defect of this program, such as an invalid value to send or a call out of order."""


class RemoteError(Exception):
    """An error of the other side, which is counted and shown; the program continues."""


class NoAnswerError(RemoteError):
    """A request got no answer; the text contains the request and the cause.

    Exit code 1.
    """

    exit_code = EXIT_FAILURE


class UserError(LocalError, ValueError):
    """A request of the user cannot be fulfilled; the text has the problem, its cause and a fix.

    Exit code 2.
    """

    exit_code = EXIT_USAGE


class ConfigError(UserError):
    """A configuration file is refused; the text has file, key, reason and fix."""

    def __init__(self, *, file: str, key: str, reason: str, fix: str) -> None:
        self.file, self.key, self.reason, self.fix = file, key, reason, fix
        where = f"{file}: {key}" if key else file
        super().__init__(f"{where}: {reason}; {fix}" if fix else f"{where}: {reason}")


class EndpointError(UserError):
    """An endpoint is invalid, or this machine cannot listen on it."""


class EndpointInUseError(UserError):
    """Another process already listens on the endpoint."""


class NoPeerError(UserError):
    """There is no process that listens on the endpoint to connect to."""


class PeerHangsError(NoPeerError):
    """A process listens on the endpoint to connect to, but does not answer."""


class AccessDeniedError(NoPeerError):
    """The peer refuses the connection; `do` is the remedy."""

    def __init__(self, why: str, do: str) -> None:
        super().__init__(f"{why}: {do}")
        self.why, self.do = why, do


class KeysError(UserError):
    """A certificate, key or authority is unusable; the text has the file, the reason and a fix."""


class ClockStoppedError(Exception):
    """Raised to a thread that waits on a stopped clock, which ends its loop."""


DECIMAL_COMMA: Final = re.compile(r"[+-]?\d+,\d+")


def decimal_point(text: str) -> str:
    """Return a number with a decimal comma as programs write it; of anything else nothing."""
    return text.replace(",", ".") if DECIMAL_COMMA.fullmatch(text) else ""


def not_a_number(text: str) -> str:
    """Return that a text is not a number; of a decimal comma also how to write it."""
    point = decimal_point(text)
    return f"{text!r} is not a number{f': write {point}' if point else ''}"
