"""Run several goals as one: send all goals before time starts, then wait for all outcomes."""

import asyncio
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

from ground.client.connection import Common
from ground.client.leases import Leasing
from ground.launch.goal_run import GoalRun, NoOutcomeError
from ground.launch.scenario import Scenario
from ground.launch.supervisor import VoidRun
from ground.robot import Robot
from ground.text.wording import Part
from protocol.bus.bus import Bus
from protocol.outcome import RunOutcome
from runtime.clock import Clock

MAX_NAMED: Final = 10
"""Robots that are named in the status line, and described in a paragraph; more are counted."""

LOOK_NS: Final = 100_000_000
TOGETHER_S: Final = 0.002
"""Time for the other messages of a tick, of all robots, to arrive."""


class FleetRun:
    """Follow several goal runs at once.

    `check` raises when a process has exited; `show` receives a status line up to ten times a
    second.
    """

    def __init__(
        self,
        goal_runs: Sequence[GoalRun],
        clock: Clock,
        check: Callable[[], None],
        show: Callable[[list[Part]], None],
    ) -> None:
        self._goal_runs = goal_runs
        self._clock = clock
        self._check = check
        self._show = show

    async def run(
        self, *, lockstep: bool, stays: bool = False, launched: Callable[[], None] = lambda: None
    ) -> list[RunOutcome]:
        """Return the outcome of each goal. Raises NoOutcomeError when the run cannot be judged.

        In lockstep time stops at the end, so that a recorder can catch up. If the stack `stays`,
        time goes on, and an outcome does not wait for an operator who drives on.
        """
        await self.launch(lockstep=lockstep)
        launched()
        for goal_run in self._goal_runs:
            await goal_run.begin()
        outcomes = await self._follow(stays=stays)
        if lockstep and not stays:
            await self._goal_runs[0].pause()
        return outcomes

    async def launch(self, *, lockstep: bool, drives: bool = True) -> None:
        """Arm every robot, send every goal and start time; without `drives` only start time."""
        first = self._goal_runs[0]
        await asyncio.gather(*(goal_run.prepare(arms=drives) for goal_run in self._goal_runs))
        if not lockstep or not drives:
            await first.start()  # the score begins with the goal
        if not drives:
            return
        await asyncio.gather(*(goal_run.send() for goal_run in self._goal_runs))
        if lockstep:
            await first.start()  # each goal arrives in the same tick of every run

    async def _follow(self, *, stays: bool) -> list[RunOutcome]:
        shown_ns = self._clock.now_ns()
        while True:
            for goal_run in self._goal_runs:
                await goal_run.look()
            now_ns = self._clock.now_ns()
            under_way = [
                one for one in self._goal_runs if not (one.is_judged if stays else one.is_over)
            ]
            is_over = not under_way
            if now_ns - shown_ns >= LOOK_NS or is_over:
                shown_ns = now_ns
                self._show(self._line())
            if is_over:
                return self._outcomes()
            self._check()
            await under_way[0].wait(LOOK_NS)
            await asyncio.sleep(TOGETHER_S)

    def _outcomes(self) -> list[RunOutcome]:
        void_reason = dict.fromkeys(
            goal_run.void_reason for goal_run in self._goal_runs if goal_run.void_reason
        )
        if void_reason:
            others = [one.short_line().text for one in self._goal_runs if one.outcome is not None]
            raise NoOutcomeError(f"no valid trial: {'; '.join([*void_reason, *others])}")
        return [goal_run.outcome for goal_run in self._goal_runs if goal_run.outcome is not None]

    def _line(self) -> list[Part]:
        first, robots = self._goal_runs[0], len(self._goal_runs)
        if robots == 1:
            return [*first.line(), first.pace()]
        if robots > MAX_NAMED:
            ended = [one.outcome for one in self._goal_runs if one.outcome is not None]
            return [Part(fleet_words(robots, ended)), first.time(), first.pace()]
        return [
            *(goal_run.short_line() for goal_run in self._goal_runs),
            first.time(),
            first.pace(),
        ]


def goal_runs_of(
    scenario: Scenario,
    common: Common,
    bus: Bus,
    clock: Clock,
    check: Callable[[], None],
    void: Callable[[str], VoidRun | None] = lambda _robot: None,
) -> list[GoalRun]:
    """Return one run for each robot; `void` returns why the trial of a robot is void."""
    return [
        GoalRun(
            Robot(bus, replace(common, robot=one.robot), clock=clock, leasing=Leasing.NEVER),
            scenario,
            one,
            check,
            partial(void, one.robot),
        )
        for one in scenario.scenario_robots
    ]


def as_json(robots: Sequence[str], outcomes: Sequence[RunOutcome]) -> dict[str, object]:
    """Return the first robot's outcome; with several robots, add each one under its name."""
    found = outcomes[0].as_json()
    if len(outcomes) > 1:
        found["robots"] = [
            {"robot": robot} | outcome.as_json()
            for robot, outcome in zip(robots, outcomes, strict=True)
        ]
    return found


def in_words(robots: Sequence[str], outcomes: Sequence[RunOutcome]) -> str:
    """Return the full text of one outcome, a paragraph for each of several, or a line of many."""
    if len(outcomes) == 1:
        return outcomes[0].text()
    many = len(outcomes) > MAX_NAMED
    lines = [
        f"{robot}: {outcome.text().splitlines()[0] if many else outcome.text()}"
        for robot, outcome in zip(robots, outcomes, strict=True)
    ]
    return "\n".join([*lines, fleet_words(len(robots), outcomes)] if many else lines)


def fleet_words(robots: int, outcomes: Sequence[RunOutcome]) -> str:
    """Return how many of many robots have ended their drive, how, and with how many contacts."""
    kinds = Counter(outcome.outcome for outcome in outcomes)
    ends = [f"{count} {kind}" for kind, count in kinds.most_common()]
    if under_way := robots - len(outcomes):
        ends.append(f"{under_way} under way")
    contacts = sum(outcome.contacts for outcome in outcomes)
    return f"{robots} robots: {', '.join(ends)}; {contacts} contacts"
