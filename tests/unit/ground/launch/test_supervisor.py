"""Processes that die or fall silent are started again, told, and spoil a trial that needed them."""

import signal
from collections.abc import Sequence

import pytest

from ground.launch.child_processes import Children, Ended
from ground.launch.hang_detector import SILENT, SILENT_NS, HangDetector
from ground.launch.restart_policy import RestartPolicy, RestartSchedule
from ground.launch.supervisor import PATIENCE_NS, SETTLED_NS, Supervisor
from runtime.clock import ManualClock

ROBOT, PLANT = "robot r1", "plant"
NEEDED = (ROBOT, PLANT)
SECOND = 1_000_000_000
KILLED = "the robot r1 process was killed (signal SIGKILL)"


class Played(Children):
    """Processes that end when the test wants it, or when they are killed."""

    def __init__(self) -> None:
        super().__init__(ManualClock())
        self.running = {ROBOT, PLANT}
        self.started: list[tuple[str, list[str]]] = []
        self.deaths: list[Ended] = []

    def start(self, role: str, arguments: Sequence[str]) -> None:
        self.running.add(role)
        self.started.append((role, list(arguments)))

    def ended(self) -> list[Ended]:
        deaths, self.deaths = self.deaths, []
        return deaths

    def send(self, role: str, number: int) -> bool:
        if role not in self.running:
            return False
        self.running.remove(role)
        self.deaths.append(Ended(role, -number, "said before"))
        return True


class Stage:
    """An upkeep, its processes and their hearts, all heard at time 0."""

    def __init__(self, *, hearts: bool = True, limit: int = 5) -> None:
        self.children = Played()
        self.hearts = HangDetector(ROBOT, [ROBOT, PLANT], lambda: True, -SECOND)
        for role in (ROBOT, PLANT):
            self.hearts.heard(role, 0)
        self.upkeep = Supervisor(
            self.children,
            RestartSchedule([ROBOT, PLANT], RestartPolicy(limit=limit)),
            self.hearts if hearts else None,
            lambda role, cause: [role, cause],
        )

    def wait(self, now_ns: int) -> None:
        """Rounds until then."""
        for at_ns in (*range(0, now_ns, SECOND // 10), now_ns):
            self.upkeep.round(at_ns)

    def kill(self, role: str, now_ns: int) -> None:
        self.children.send(role, signal.SIGKILL)
        self.upkeep.round(now_ns)


def test_who_dies_is_started_again_with_the_cause_and_told_once() -> None:
    stage = Stage()
    stage.kill(ROBOT, 5)
    assert stage.children.started == [(ROBOT, [ROBOT, "was killed (signal SIGKILL)"])]
    assert stage.upkeep.news() == f"{KILLED}; it is started again"
    assert stage.upkeep.news() == ""


def test_who_is_silent_is_killed_and_called_hung() -> None:
    stage = Stage()
    stage.wait(SILENT_NS + 1)
    assert stage.children.started == [(ROBOT, [ROBOT, SILENT])]
    assert "hung (not heard for 2.5 s)" in stage.upkeep.news()


def test_in_lockstep_time_may_stand_still_and_nobody_hangs() -> None:
    stage = Stage(hearts=False)
    stage.upkeep.round(100 * SECOND)
    assert stage.children.started == []
    stage.kill(ROBOT, 100 * SECOND)
    assert len(stage.children.started) == 1


def test_who_is_given_up_is_not_started_again() -> None:
    stage = Stage(limit=0)
    stage.kill(ROBOT, 0)
    stage.upkeep.round(100 * SECOND)
    assert stage.children.started == []
    assert stage.upkeep.news().startswith("GIVEN UP")
    void = stage.upkeep.void(NEEDED, 0)
    assert void is not None
    assert void == (f"{KILLED} and is given up", True)


def test_a_trial_counts_as_long_as_nobody_it_needs_has_died() -> None:
    stage = Stage()
    assert stage.upkeep.void(NEEDED, 0) is None
    stage.kill(PLANT, 0)
    assert stage.upkeep.void((ROBOT,), 0) is None
    assert stage.upkeep.void(NEEDED, 0) is not None


@pytest.mark.parametrize("back", [True, False])
def test_a_spoilt_trial_waits_until_it_is_told_or_does_not_come_back(back: bool) -> None:
    stage = Stage()
    stage.kill(ROBOT, 0)
    if back:
        stage.hearts.heard(ROBOT, SECOND)
    void = stage.upkeep.void(NEEDED, SETTLED_NS + 1)
    assert void is not None
    assert void.over is back
    assert ("it is back" in void.why) is back
    void = stage.upkeep.void(NEEDED, PATIENCE_NS + 1)
    assert void is not None
    assert void.over
