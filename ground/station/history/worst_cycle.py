"""The dearest control cycle of each second: what changes with every tick cannot be read."""

from math import inf

from protocol.wire.messages import CycleReport


class Dearest:
    """`cycle` is replaced at once by a dearer one, and by a cheaper one when its second is over."""

    def __init__(self) -> None:
        self.cycle: CycleReport | None = None
        self._this: CycleReport | None = None
        self._second = -1

    def add(self, cycle: CycleReport, time_s: float) -> None:
        """The next cycle; times must not go back."""
        second = int(time_s)
        if second > self._second:
            before = self._this if second == self._second + 1 else None
            self.cycle, self._this, self._second = before, None, second
        if spent_us(cycle) > spent_us(self._this):
            self._this = cycle
        if spent_us(cycle) > spent_us(self.cycle):
            self.cycle = cycle


def spent_us(cycle: CycleReport | None) -> float:
    """In all stages; less than any when there is no cycle."""
    return -inf if cycle is None else sum(cycle.stage_us)
