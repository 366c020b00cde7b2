"""Several errands as one run: all goals are given before time goes on, all ends are waited for."""

from collections.abc import Callable, Sequence
from typing import Final

from ground.launch.goal_run import GoalRun, NotRun
from ground.text.status_parts import Part
from protocol.outcome import Outcome
from runtime.clock import Clock

LOOK_NS: Final = 100_000_000
PAUSE_NS: Final = 2_000_000


class FleetRun:
    """`check` raises when a process has died; `show` gets a line now and then."""

    def __init__(
        self,
        errands: Sequence[GoalRun],
        clock: Clock,
        check: Callable[[], None],
        show: Callable[[list[Part]], None],
    ) -> None:
        self._errands = errands
        self._clock = clock
        self._check = check
        self._show = show

    def run(self, *, lockstep: bool, launched: Callable[[], None] = lambda: None) -> list[Outcome]:
        """The outcome of each. Raises NotRun when there is nothing to judge."""
        self.launch(lockstep=lockstep)
        launched()
        for errand in self._errands:
            errand.begin()
        return self._follow()

    def launch(self, *, lockstep: bool) -> None:
        """Every robot armed, with its goal, and time going on."""
        first = self._errands[0]
        for errand in self._errands:
            errand.prepare()
        if not lockstep:
            first.start()  # so that the score begins with the goal
        for errand in self._errands:
            errand.send()
        if lockstep:
            first.start()  # the goals are there in the same tick every time

    def _follow(self) -> list[Outcome]:
        shown_ns = self._clock.now_ns()
        while True:
            for errand in self._errands:
                errand.look()
            now_ns = self._clock.now_ns()
            over = all(errand.over for errand in self._errands)
            if now_ns - shown_ns >= LOOK_NS or over:
                shown_ns = now_ns
                self._show(self._line())
            if over:
                return self._outcomes()
            self._check()
            self._clock.sleep_until(now_ns + PAUSE_NS)

    def _outcomes(self) -> list[Outcome]:
        spoilt = dict.fromkeys(errand.spoilt for errand in self._errands if errand.spoilt)
        if spoilt:
            others = [one.short_line().text for one in self._errands if one.outcome is not None]
            raise NotRun(f"no valid trial: {'; '.join([*spoilt, *others])}")
        return [errand.outcome for errand in self._errands if errand.outcome is not None]

    def _line(self) -> list[Part]:
        if len(self._errands) == 1:
            return self._errands[0].line()
        return [*(errand.short_line() for errand in self._errands), self._errands[0].time()]


def as_json(robots: Sequence[str], outcomes: Sequence[Outcome]) -> dict[str, object]:
    """The first robot's outcome, and, where there are several, each one's under its name."""
    found = outcomes[0].as_json()
    if len(outcomes) > 1:
        found["robots"] = [
            {"robot": robot} | outcome.as_json()
            for robot, outcome in zip(robots, outcomes, strict=True)
        ]
    return found


def in_words(robots: Sequence[str], outcomes: Sequence[Outcome]) -> str:
    """For a person: the whole story of one, or a paragraph for each."""
    if len(outcomes) == 1:
        return outcomes[0].text()
    return "\n".join(
        f"{robot}: {outcome.text()}" for robot, outcome in zip(robots, outcomes, strict=True)
    )
