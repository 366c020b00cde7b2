"""Counts restarts of a process: a new token, or a count of its own that begins again."""

from typing import Literal

Sign = Literal["token", "count"]


class Restarts:
    """Both signs of one restart count once, in whichever order they come.

    A number up to `overtaken` behind the highest only came late.
    """

    def __init__(self, overtaken: int = 0) -> None:
        self.count = 0
        self._overtaken = overtaken
        self._token = ""
        self._number = -1
        self._owed: Sign | None = None

    def token(self, zid: str) -> bool:
        """Its token is there; True when that shows a restart."""
        if not zid or zid == self._token:
            return False
        first, self._token = not self._token, zid
        return False if first else self._counted("token")

    def number(self, number: int) -> bool:
        """Its tick or its time; True when that shows a restart."""
        behind = self._number - number
        if 0 < behind <= self._overtaken:
            return False
        self._number = number
        return behind > 0 and self._counted("count")

    def _counted(self, sign: Sign) -> bool:
        if self._owed is not None and self._owed != sign:
            self._owed = None
            return False
        self._owed = sign
        self.count += 1
        return True
