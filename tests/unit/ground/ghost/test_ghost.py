"""A ghost is a run like any other, in a process of its own that never outlives its use."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from ground.ghost.branch_point import FAILED, PredictedPath
from ground.ghost.ghost import CANCELLED, Ghost, Ghosts
from plant.world.file import load
from protocol.world import as_json
from runtime.clock import ManualClock
from study.trial.trial import NAVIGATORS, Trial
from tests.support.each import each
from tests.support.ground.ghost.runs import driven, ghost_in, goal_in
from tests.support.until import until

ROOT = Path(__file__).parents[4]
FOREVER = "import time; print('time_s,true_x_m,true_y_m', flush=True); time.sleep(60)"
START = (0.6, 2.0, 0.0)


def ended(ghost: Ghost) -> PredictedPath:
    ghost.start()
    until(lambda: ghost.poll() is not None)
    course = ghost.poll()
    assert course is not None
    return course


def alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def sockets(pid: int) -> bool:
    """Has it got as far as opening any?"""
    with suppress(FileNotFoundError):
        files = [str(file.readlink()) for file in Path(f"/proc/{pid}/fd").iterdir()]
        return any("socket" in file for file in files)
    return False


def instead(source: str) -> Callable[[Sequence[str], int], list[str]]:
    """Return a command that runs other Python source instead of a ghost."""
    return lambda words, parent: [sys.executable, "-c", source]


def stubborn(**more: Any) -> Ghost:
    return Ghost("box", START, 0.0, goal_in("box"), "bug", command_of=instead(FOREVER), **more)


@pytest.mark.sweep(3)
@pytest.mark.parametrize("navigator", NAVIGATORS)
def test_ghost_without_noise_repeats_the_run(navigator: str) -> None:
    outcome, places = driven(Trial(world=load("box"), navigator=navigator, noise="none"))
    course = ended(ghost_in("box", navigator))
    assert (course.outcome, course.reason) == (outcome.outcome, outcome.reason)
    assert (course.time_s, course.length_m) == (outcome.time_s, outcome.path_m)
    assert set(course.path_m) <= set(places)
    assert (course.path_m[0], course.path_m[-1]) == (places[0], places[-1])


@each("at_s", [0.0, 7.3])
def test_among_things_that_move_too_from_any_time_on(at_s: float) -> None:
    trial = Trial(world=load("moving"), noise="none", at_s=at_s, moved=True)
    outcome, places = driven(trial)
    start = trial.world.start
    pose = (start.x_m, start.y_m, start.heading_rad)
    with Ghost("moving", pose, at_s, goal_in("moving"), "vgm_memory") as ghost:
        course = ended(ghost)
    assert (course.time_s, course.length_m) == (outcome.time_s, outcome.path_m)
    assert course.path_m[-1] == places[-1]


def test_noise_seed_side_and_parameters_are_those_asked_for() -> None:
    trial = Trial(
        world=load("box"),
        navigator="bug",
        side="right",
        noise="default",
        seed=4,
        parameters={"v_max_m_s": 0.2},
    )
    outcome, _ = driven(trial)
    more = {"noise": "default", "seed": 4, "side": "right", "parameters": {"v_max_m_s": 0.2}}
    course = ended(ghost_in("box", "bug", **more))
    assert (course.time_s, course.length_m) == (outcome.time_s, outcome.path_m)


def test_world_received_from_the_plant_needs_no_file() -> None:
    outcome, _ = driven(Trial(world=load("u_trap"), navigator="bug", noise="none"))
    facts = dict(as_json(load("u_trap"), 5.1))
    with Ghost(facts, START, 0.0, goal_in("u_trap"), "bug") as ghost:
        assert ended(ghost).length_m == outcome.path_m


@pytest.mark.sweep(3)
@pytest.mark.parametrize(
    ("ghost", "said"),
    [
        (Ghost("nowhere", START, 0.0, goal_in("box"), "bug"), "no shipped world"),
        (Ghost("box", (3.0, 2.0, 0.0), 0.0, goal_in("box"), "bug"), "the start (3, 2) is taken"),
        (Ghost("box", (9.0, 2.0, 0.0), 0.0, goal_in("box"), "bug"), "outside the world"),
        (Ghost("box", (float("nan"), 2.0, 0.0), 0.0, goal_in("box"), "bug"), "finite"),
        (Ghost("box", START, -1.0, goal_in("box"), "bug"), "not within 0"),
        (Ghost("box", START, 0.0, goal_in("box"), "vfh"), "invalid choice"),
        (Ghost("box", START, 0.0, goal_in("box"), "bug", {"nonsense": 1.0}), "nonsense"),
        (Ghost({"name": "x"}, START, 0.0, goal_in("box"), "bug"), "missing"),
    ],
)
def test_what_cannot_be_run_fails_with_the_reason(ghost: Ghost, said: str) -> None:
    course = ended(ghost)
    assert (course.outcome, course.path_m, course.length_m) == (FAILED, [], None)
    assert said in course.reason


def test_cancelled_it_is_gone_and_stays_so() -> None:
    ghost = stubborn()
    ghost.start()
    pid = ghost.pid
    assert pid is not None
    until(lambda: ghost.poll() is None)
    ghost.cancel()
    assert not alive(pid)
    course = ghost.poll()
    assert course is not None
    assert (course.outcome, ghost.pid, ghost.running) == (CANCELLED, None, False)
    ghost.start()
    ghost.cancel()
    assert ghost.pid is None
    assert ghost.poll() == course


def test_one_that_was_never_started_can_be_cancelled() -> None:
    ghost = stubborn()
    assert ghost.poll() is None
    ghost.cancel()
    assert ghost.poll() == PredictedPath([], CANCELLED, CANCELLED)


def test_leaving_the_block_ends_it_whatever_happened() -> None:
    pids: list[int] = []

    def fail() -> None:
        with stubborn() as ghost:
            ghost.start()
            pids.append(ghost.pid or 0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert pids
    assert not alive(pids[0])


def test_one_that_takes_too_long_is_given_up() -> None:
    clock = ManualClock()
    ghost = stubborn(patience_s=5.0, clock=clock)
    ghost.start()
    assert ghost.poll() is None
    pid = ghost.pid
    clock.advance(5_000_000_000)
    course = ghost.poll()
    assert course is not None
    assert (course.outcome, course.reason) == (FAILED, "given up after 5 s")
    assert pid is not None
    assert not alive(pid)


def test_killed_process_is_reported_with_its_signal() -> None:
    ghost = stubborn()
    ghost.start()
    assert ghost.pid is not None
    os.kill(ghost.pid, signal.SIGKILL)
    until(lambda: ghost.poll() is not None)
    assert ghost.poll() == PredictedPath([], FAILED, "the process ended with signal SIGKILL")


def test_failed_process_start_is_reported() -> None:
    ghost = ghost_in("box", command_of=lambda words, parent: ["/nowhere/at/all"])
    assert ended(ghost) == PredictedPath(
        [], FAILED, "the process cannot be started: No such file or directory"
    )


PARENT = """
import sys
from ground.launch.child_command import command
from tests.support.ground.ghost.runs import ghost_in
endless = ["router", "--listen", "tcp/127.0.0.1:0"]
ghost = ghost_in("box", command_of=lambda words, parent: command(endless, parent))
ghost.start()
print(ghost.pid, flush=True)
sys.stdin.read()
"""


def test_a_killed_parent_takes_its_ghosts_with_it() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PARENT],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        until(lambda: sockets(child))  # by then it is tied to its parent
        parent.send_signal(signal.SIGKILL)
    until(lambda: not alive(child))


def test_its_path_can_be_seen_while_it_drives() -> None:
    source = (
        "import time; print('time_s,true_x_m,true_y_m\\n0,1.0,2.0\\n0,1.5,2.0', flush=True);"
        "time.sleep(60)"
    )
    with Ghost("box", START, 0.0, goal_in("box"), "bug", command_of=instead(source)) as ghost:
        ghost.start()
        until(lambda: ghost.poll() is None and len(ghost.path_m) == 2)
        assert ghost.path_m == [(1.0, 2.0), (1.5, 2.0)]


def test_ghosts_above_the_limit_wait_for_their_turn() -> None:
    with Ghosts(most=2) as ghosts:
        for navigator in ("bug", "bug2", "distbug", "vgm_memory"):
            ghosts.add(navigator, ghost_in("box", navigator))
        most = 0
        done: list[str] = []
        pause = Event()
        while ghosts.busy:
            pause.wait(0.01)
            most = max(most, len(ghosts.pids))
            done += ghosts.poll()
        assert most == 2
        assert sorted(done) == ["bug", "bug2", "distbug", "vgm_memory"]
        assert ghosts.poll() == []
        assert {course.outcome for course in ghosts.courses.values() if course} == {"reached"}
        assert [trail.label for trail in ghosts.trails()] == list(ghosts.courses)
        assert all(trail.outcome == "reached" and trail.path_m for trail in ghosts.trails())


def test_new_ghost_replaces_one_with_the_same_label() -> None:
    with Ghosts(most=1) as ghosts:
        ghosts.add("one", stubborn())
        (first,) = ghosts.pids
        ghosts.add("one", stubborn())
        (second,) = ghosts.pids
        assert not alive(first)
        assert ghosts.courses == {"one": None}
        assert [trail.outcome for trail in ghosts.trails()] == [""]
        ghosts.remove("one")
        ghosts.remove("one")
        assert not alive(second)
        assert not ghosts.busy


def test_when_all_are_left_none_is_left_behind() -> None:
    with Ghosts(most=3) as ghosts:
        for number in range(5):
            ghosts.add(str(number), stubborn())
        pids = ghosts.pids
        assert len(pids) == 3
    assert not any(alive(pid) for pid in pids)
    assert ghosts.courses == {}
