"""Test runs of several robots: order of goals and start, end of the run, JSON."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from ground.launch.fleet_run import FleetRun, as_json, in_words
from ground.launch.goal_run import GoalRun, NoOutcomeError
from ground.text.status_parts import Part
from protocol.outcome import Outcome
from runtime.clock import ManualClock

REACHED = Outcome(
    world="box",
    navigator="vgm",
    seed=0,
    noise="none",
    wall_s=1.0,
    outcome="reached",
    reason="ok",
    time_s=10.0,
    path_m=3.0,
    shortest_path_m=None,
    position_error_m=0.01,
    heading_error_rad=None,
    estimated_position_error_m=0.0,
    min_clearance_m=0.2,
    contacts=0,
    own_contacts=0,
    ticks=200,
    missed_ticks=0,
    digest="00",
)


class RecordedRun(GoalRun):
    """A goal run that records its calls and ends after some rounds."""

    def __init__(self, name: str, looks: int, calls: list[str]) -> None:
        self.name = name
        self.outcome = None
        self.void_reason = ""
        self._looks = looks
        self._calls = calls

    def prepare(self) -> None:
        self._calls.append(f"prepare {self.name}")

    def start(self) -> None:
        self._calls.append("start")

    def pause(self) -> None:
        self._calls.append("pause")

    def send(self) -> None:
        self._calls.append(f"send {self.name}")

    def begin(self) -> None:
        self._calls.append(f"begin {self.name}")

    def look(self) -> None:
        self._looks -= 1
        if self._looks == 0:
            self.outcome = replace(REACHED, path_m=float(len(self.name)))

    def line(self) -> list[Part]:
        return [Part(self.name), Part("alone")]

    def time(self) -> Part:
        return Part("3 s")

    def pace(self) -> Part:
        return Part("SIM 0.5x, computer busy" if len(self.name) > 2 else "")

    def short_line(self) -> Part:
        return Part(f"{self.name} {'there' if self.outcome else 'on its way'}")


def fleet_run(
    *looks: int, check: Callable[[], None] = lambda: None
) -> tuple[FleetRun, list[str], list[list[Part]]]:
    calls: list[str] = []
    shown: list[list[Part]] = []
    goal_runs = [RecordedRun(f"r{number + 1}", count, calls) for number, count in enumerate(looks)]
    return FleetRun(goal_runs, ManualClock(), check, shown.append), calls, shown


def test_lockstep_sends_all_goals_before_start() -> None:
    run, calls, _ = fleet_run(1, 1)
    run.run(lockstep=True)
    assert calls == [
        "prepare r1",
        "prepare r2",
        "send r1",
        "send r2",
        "start",
        "begin r1",
        "begin r2",
        "pause",
    ]


def test_wall_time_starts_the_score_before_the_goals() -> None:
    run, calls, _ = fleet_run(1, 1)
    run.run(lockstep=False)
    assert calls[2:5] == ["start", "send r1", "send r2"]
    assert "pause" not in calls


def test_fleet_run_ends_with_the_last_robot() -> None:
    run, _, shown = fleet_run(200, 3)
    assert len(run.run(lockstep=True)) == 2
    assert [part.text for part in shown[0]] == ["r1 on its way", "r2 there", "3 s", ""]
    assert [part.text for part in shown[-1]] == ["r1 there", "r2 there", "3 s", ""]


def test_single_robot_uses_the_full_line() -> None:
    run, _, shown = fleet_run(1)
    run.run(lockstep=True)
    assert [part.text for part in shown[-1]] == ["r1", "alone", ""]


def test_exit_of_a_process_ends_the_run() -> None:
    def check() -> None:
        raise NoOutcomeError("gone")

    with pytest.raises(NoOutcomeError, match="gone"):
        fleet_run(5, check=check)[0].run(lockstep=True)


def test_restart_voids_the_trial_after_others_arrive() -> None:
    run, calls, shown = fleet_run(50, 3)
    lost = run._goal_runs[1]
    lost.void_reason = "the robot r2 process was killed (signal SIGKILL)"
    with pytest.raises(NoOutcomeError, match=r"no valid trial: .* \(signal SIGKILL\); r1 there"):
        run.run(lockstep=False, launched=lambda: calls.append("launched"))
    assert calls[5:] == ["launched", "begin r1", "begin r2"]
    assert shown[-1][0].text == "r1 there"


def test_single_outcome_is_printed_alone() -> None:
    assert as_json(["r1"], [REACHED]) == REACHED.as_json()
    assert in_words(["r1"], [REACHED]) == REACHED.text()


def test_several_outcomes_extend_the_first() -> None:
    stuck = replace(REACHED, outcome="stuck")
    found = as_json(["r1", "r2"], [REACHED, stuck])
    robots = found.pop("robots")
    assert found == REACHED.as_json()
    assert robots == [{"robot": "r1", **REACHED.as_json()}, {"robot": "r2", **stuck.as_json()}]
    assert "r2: " in in_words(["r1", "r2"], [REACHED, stuck])
