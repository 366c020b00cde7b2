"""Let a key with a large effect act only at its second press."""

from collections.abc import Callable
from math import inf


class SecondPress:
    """Notes the first press of a key; the second within `within_s` acts.

    `time_s` returns the time. A press for another `subject` counts as a first one.
    """

    def __init__(self, time_s: Callable[[], float], within_s: float) -> None:
        self._time_s = time_s
        self._within_s = within_s
        self._pressed_s = -inf
        self._subject = ""

    def is_second(self, subject: str = "") -> bool:
        """Note a press; return whether it is the second one."""
        now_s = self._time_s()
        second = subject == self._subject and 0.0 <= now_s - self._pressed_s <= self._within_s
        self._pressed_s, self._subject = -inf if second else now_s, subject
        return second
