"""Measure the cost and lateness of each control cycle, and check the budget."""

from typing import Final

from protocol.wire.messages import CycleReport
from robot.core.brain import STAGES, TICK_US
from runtime.clock import Clock, Tick
from runtime.units import UINT32

OVERRUNS_IN_A_ROW: Final = 3
LAST_STAGE: Final = len(STAGES) - 1


class CycleMeter:
    """CPU time per stage of the current tick.

    In lockstep (`enforced` false) simulated time pauses during a cycle. Nothing is late then, and
    no verdict depends on the load of the machine.
    """

    def __init__(self, clock: Clock, *, period_ns: int, enforced: bool) -> None:
        self._clock = clock
        self._period_ns = period_ns
        self._enforced = enforced
        self._stage_us = [0] * len(STAGES)
        self._marked_ns = self._begun_ns = 0
        self._last_ns: int | None = None
        self._stalled = False
        self._in_a_row = 0
        self._tick = Tick(0, 0, 0, 0)
        self.overruns = 0

    def begin(self, tick: Tick) -> None:
        """Start measuring a tick."""
        self._tick = tick
        now_ns = self._clock.now_ns()
        self._stalled = self._last_ns is not None and now_ns - self._last_ns > 2 * self._period_ns
        self._last_ns = now_ns
        self._begun_ns = self._marked_ns = self._clock.cpu_ns()

    def mark(self, stage: int) -> None:
        """Note that a stage has just ended."""
        now_ns = self._clock.cpu_ns()
        self._stage_us[stage] = (now_ns - self._marked_ns) // 1000
        self._marked_ns = now_ns

    def end(self) -> None:
        """End the cycle and compare its cost with the budget."""
        self.mark(LAST_STAGE)
        over = (self._marked_ns - self._begun_ns) // 1000 > TICK_US
        self.overruns += over
        self._in_a_row = self._in_a_row + 1 if over else 0

    @property
    def violated(self) -> bool:
        """True after three overruns in a row, or for a tick more than one period late.

        A process that was suspended resumes with a fresh frame. Only the time since the previous
        tick shows that it is late.
        """
        late = self._stalled or self._tick.late_ns > self._period_ns
        return self._enforced and (late or self._in_a_row >= OVERRUNS_IN_A_ROW)

    def report(self, time_ns: int, *, sense_age_us: int, rejected: int) -> CycleReport:
        """Return the report of this tick.

        Its last stage is still running, so that of the previous tick is reported. The tick number
        wraps; other values are limited to 32 bits.
        """
        return CycleReport(
            time_ns=time_ns,
            tick=self._tick.index & UINT32,
            missed=min(self._tick.missed, UINT32),
            overruns=min(self.overruns, UINT32),
            rejected=min(rejected, UINT32),
            late_us=min(max(0, self._tick.late_ns) // 1000, UINT32),
            sense_age_us=min(sense_age_us, UINT32),
            budget_us=TICK_US,
            stage_us=tuple([min(spent_us, 65_535) for spent_us in self._stage_us]),
        )
