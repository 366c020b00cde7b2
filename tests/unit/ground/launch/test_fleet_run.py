"""Several robots as one run: goals before time, the end when the last has ended, one object."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from ground.launch.fleet_run import FleetRun, as_json, in_words
from ground.launch.goal_run import GoalRun, NotRun
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


class Played(GoalRun):
    """An errand that only takes down what is done with it, and ends after some looks."""

    def __init__(self, name: str, looks: int, diary: list[str]) -> None:
        self.name = name
        self.outcome = None
        self.spoilt = ""
        self._looks = looks
        self._diary = diary

    def prepare(self) -> None:
        self._diary.append(f"prepare {self.name}")

    def start(self) -> None:
        self._diary.append("start")

    def send(self) -> None:
        self._diary.append(f"send {self.name}")

    def begin(self) -> None:
        self._diary.append(f"begin {self.name}")

    def look(self) -> None:
        self._looks -= 1
        if self._looks == 0:
            self.outcome = replace(REACHED, path_m=float(len(self.name)))

    def line(self) -> list[Part]:
        return [Part(self.name), Part("alone")]

    def time(self) -> Part:
        return Part("3 s")

    def short_line(self) -> Part:
        return Part(f"{self.name} {'there' if self.outcome else 'on its way'}")


def outing(
    *looks: int, check: Callable[[], None] = lambda: None
) -> tuple[FleetRun, list[str], list[list[Part]]]:
    diary: list[str] = []
    shown: list[list[Part]] = []
    errands = [Played(f"r{number + 1}", count, diary) for number, count in enumerate(looks)]
    return FleetRun(errands, ManualClock(), check, shown.append), diary, shown


def test_in_lockstep_every_goal_is_given_before_time_goes_on() -> None:
    run, diary, _ = outing(1, 1)
    run.run(lockstep=True)
    assert diary == [
        "prepare r1",
        "prepare r2",
        "send r1",
        "send r2",
        "start",
        "begin r1",
        "begin r2",
    ]


def test_in_wall_time_the_score_begins_just_before_the_goals() -> None:
    run, diary, _ = outing(1, 1)
    run.run(lockstep=False)
    assert diary[2:5] == ["start", "send r1", "send r2"]


def test_it_ends_with_the_last_robot_and_shows_each() -> None:
    run, _, shown = outing(200, 3)
    assert len(run.run(lockstep=True)) == 2
    assert [part.text for part in shown[0]] == ["r1 on its way", "r2 there", "3 s"]
    assert [part.text for part in shown[-1]] == ["r1 there", "r2 there", "3 s"]


def test_one_robot_has_the_line_for_itself() -> None:
    run, _, shown = outing(1)
    run.run(lockstep=True)
    assert [part.text for part in shown[-1]] == ["r1", "alone"]


def test_a_process_that_dies_ends_the_run() -> None:
    def check() -> None:
        raise NotRun("gone")

    with pytest.raises(NotRun, match="gone"):
        outing(5, check=check)[0].run(lockstep=True)


def test_a_trial_whose_robot_was_started_again_is_none_but_the_others_arrive() -> None:
    run, diary, shown = outing(50, 3)
    lost = run._errands[1]
    lost.spoilt = "the robot r2 process was killed (signal SIGKILL)"
    with pytest.raises(NotRun, match=r"no valid trial: .* \(signal SIGKILL\); r1 there"):
        run.run(lockstep=False, launched=lambda: diary.append("launched"))
    assert diary[5:] == ["launched", "begin r1", "begin r2"]
    assert shown[-1][0].text == "r1 there"


def test_one_robot_prints_what_it_always_did() -> None:
    assert as_json(["r1"], [REACHED]) == REACHED.as_json()
    assert in_words(["r1"], [REACHED]) == REACHED.text()


def test_several_are_one_object_that_begins_with_the_first() -> None:
    stuck = replace(REACHED, outcome="stuck")
    found = as_json(["r1", "r2"], [REACHED, stuck])
    robots = found.pop("robots")
    assert found == REACHED.as_json()
    assert robots == [{"robot": "r1", **REACHED.as_json()}, {"robot": "r2", **stuck.as_json()}]
    assert "r2: " in in_words(["r1", "r2"], [REACHED, stuck])
