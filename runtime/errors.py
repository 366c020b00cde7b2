"""Whose fault it is: ours (LocalError), the user's (UserError), the other side's (RemoteError)."""


class LocalError(Exception):
    """Our own bug: a value that may not be sent, a call out of order. Raised, never counted."""


class RemoteError(Exception):
    """Something the other side did: count it, show it, go on."""


class NoAnswer(RemoteError):
    """A question stayed without an answer; the text says which and why."""

    exit_code = 1


class UserError(LocalError, ValueError):
    """Something a person asked for cannot be done; the text says what, why and what to do."""

    exit_code = 2


class ConfigError(UserError):
    """A configuration file is refused: which file and key, why, and how to put it right."""

    def __init__(self, *, file: str, key: str, reason: str, fix: str) -> None:
        self.file, self.key, self.reason, self.fix = file, key, reason, fix
        where = f"{file}: {key}" if key else file
        super().__init__(f"{where}: {reason}; {fix}" if fix else f"{where}: {reason}")


class BadEndpoint(UserError):
    """An endpoint that cannot be understood, or that this machine cannot listen on."""


class EndpointInUse(UserError):
    """Somebody else listens there already."""


class NoPeer(UserError):
    """Nobody listens where this process was told to connect."""


class PeerHangs(NoPeer):
    """Somebody listens where this process was told to connect, and does not answer."""


class NotLetIn(NoPeer):
    """Who listens where this process was told to connect does not let it in; `do` is the remedy."""

    def __init__(self, why: str, do: str) -> None:
        super().__init__(f"{why}: {do}")
        self.why, self.do = why, do


class BadKeys(UserError):
    """A certificate, key or authority that cannot be used: which file, why, and what to do."""


class Stopped(Exception):
    """Raised to whoever waits on a clock that will not go on; a loop simply ends."""
