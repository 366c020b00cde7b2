"""When something is to be told again: at once when it has changed, else every so often."""


class Occasion:
    """`due` is asked as often as one likes and says yes on the occasions."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._told: object = self
        self._due_ns = 0

    def due(self, what: object, now_ns: int) -> bool:
        if what == self._told and now_ns < self._due_ns:
            return False
        self._told = what
        self._due_ns = now_ns + self._period_ns
        return True
