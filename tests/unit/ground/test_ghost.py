"""Ghosts: runs from an instant of a robot or recording, in processes of their own."""

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from math import nan, pi, radians
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.crew import alive
from checks.harness.until import until
from ground.branch_point import (
    FAILED,
    STEP_M,
    BranchPoint,
    GhostRecording,
    PathReader,
    PredictedPath,
    changed_in,
    driving,
    number,
    trial_words,
    world_bytes,
)
from ground.cli.main import main
from ground.client.goal import Destination, destination
from ground.ghost import (
    CANCELLED,
    CHOICES,
    Ghost,
    GhostRunner,
    Ghosts,
    instant_of,
    result_line,
)
from ground.recording.log_reader import LogIndex
from ground.station.station import Station
from plant.world.file import load
from protocol.bus.mailbox import Sample
from protocol.navigators import NAVIGATORS
from protocol.options import numbers_kept
from protocol.outcome import RunOutcome, rounded_heading_rad
from protocol.topics import CLOCK, COMMANDED, ENCODING, ODOMETRY, STATUS, TRUTH
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState
from protocol.wire.messages import GoalRequest, SystemTime
from protocol.world import GoalPose, as_json
from robot.core.parameters import DEFAULTS
from runtime.clock import ManualClock
from runtime.errors import UserError
from runtime.units import NS_PER_S as S
from study.cli.trial import goal_of, parser, start_of
from study.trial.trial import Trial, wire_goal_of
from tests.support.each import each
from tests.support.ground.recordings import (
    WORLD,
    Recording,
    Show,
    box,
    driven,
    ghost_in,
    goal_in,
    recorded,
    standing,
)

ROOT = Path(__file__).parents[3]
FOREVER = "import time; print('time_s,true_x_m,true_y_m', flush=True); time.sleep(60)"
START = (0.6, 2.0, 0.0)


def ended(ghost: Ghost) -> PredictedPath:
    ghost.start()
    until(lambda: ghost.poll() is not None)
    course = ghost.poll()
    assert course is not None
    return course


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
    text = json.dumps(as_json(load("u_trap"), 5.1))
    with Ghost(text, START, 0.0, goal_in("u_trap"), "bug") as ghost:
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
        (Ghost('{"name": "x"}', START, 0.0, goal_in("box"), "bug"), "missing"),
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
from tests.support.ground.recordings import ghost_in
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
    said = run((1.0, 2.0), (1.5, 2.0)) + END + b"\n"
    short = instead(f"import sys; sys.stdout.buffer.write({said!r})")
    with Ghosts(most=2) as ghosts:
        for navigator in ("bug", "bug2", "distbug", "vgm_memory"):
            ghosts.add(navigator, ghost_in("box", navigator, command_of=short))
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
        assert {course.outcome for course in ghosts.courses.values() if course} == {"stuck"}
        assert [trail.label for trail in ghosts.trails()] == list(ghosts.courses)
        assert all(trail.outcome == "stuck" and trail.path_m for trail in ghosts.trails())


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


HEAD = b"time_s,true_x_m,true_y_m,more\n"
END = json.dumps(
    {"outcome": "stuck", "reason": "no way", "time_s": 1.5, "path_m": 0.7, "contacts": 2}
).encode()


def run(*places: tuple[float, float]) -> bytes:
    rows = [f"{tick / 20},{x_m},{y_m},0\n" for tick, (x_m, y_m) in enumerate(places)]
    return HEAD + "".join(rows).encode()


def taken(*pieces: bytes) -> PathReader:
    reading = PathReader()
    for piece in pieces:
        reading.take(piece)
    return reading


def test_a_whole_run_is_a_path_and_how_it_ended() -> None:
    reading = taken(run((1.0, 2.0), (1.5, 2.0)) + END + b"\n")
    assert reading.course("") == PredictedPath(
        [(1.0, 2.0), (1.5, 2.0)], "stuck", "no way", 1.5, 0.7, 2
    )


@given(st.lists(st.integers(0, 400), max_size=8))
def test_the_pieces_in_which_it_comes_do_not_matter(cuts: list[int]) -> None:
    whole = run((1.0, 2.0), (1.5, 2.0), (1.5, 2.5)) + END + b"\n"
    places = [0, *sorted(min(cut, len(whole)) for cut in cuts), len(whole)]
    pieces = [whole[a:b] for a, b in pairwise(places)]
    assert taken(*pieces).course("") == taken(whole).course("")


def test_close_points_are_dropped_except_the_last() -> None:
    places = [(1.0 + 0.001 * tick, 2.0) for tick in range(100)]
    driving = taken(run(*places))
    assert len(driving.path_m) <= 0.1 / STEP_M + 1
    driving.take(END + b"\n")
    assert (driving.path_m[0], driving.path_m[-1]) == (places[0], places[-1])


def test_stationary_robot_is_one_point() -> None:
    assert taken(run(*[(1.0, 2.0)] * 50) + END + b"\n").path_m == [(1.0, 2.0)]


def test_without_an_outcome_it_failed_for_the_reason_given() -> None:
    course = taken(run((1.0, 2.0))).course("it was ended")
    assert course == PredictedPath([(1.0, 2.0)], FAILED, "it was ended")


@each(
    "line",
    [
        b"{",
        b"{}",
        b"[1, 2]",
        b'{"outcome": 3}',
        b"{" + b'"a":{' * 100_000,
        b"nonsense",
        b"",
        b"\xff\xfe",
        b"1,2",
        b"1,nan,2",
        b"1,inf,2",
        b"1,x,y",
    ],
)
def test_lines_that_are_none_are_left_out(line: bytes) -> None:
    assert taken(line + b"\n" + run((1.0, 2.0)) + line + b"\n").path_m == [(1.0, 2.0)]
    assert taken(line + b"\n").course("why").outcome == FAILED


@given(st.binary(max_size=200), st.binary(max_size=200))
def test_any_bytes_can_come(before: bytes, after: bytes) -> None:
    assert isinstance(taken(before, run((1.0, 2.0)), after, END, b"\n").course(""), PredictedPath)


@each(("value", "found"), [(1, 1.0), (2.5, 2.5), (None, None), ("3", None), (float("nan"), None)])
def test_what_is_no_number_is_missing(value: object, found: float | None) -> None:
    assert number(value) == found


@pytest.fixture(scope="module")
def drive() -> tuple[Recording, RunOutcome]:
    return box("bug")


@pytest.fixture
def show(drive: tuple[Recording, RunOutcome], tmp_path: Path) -> Iterator[Show]:
    shown = Show(drive[0], tmp_path, 6.0)
    yield shown
    asyncio.run(shown.station.close())


def haunting_of(show: Show) -> GhostRunner:
    return GhostRunner(lambda: show.station)


def await_end(haunting: GhostRunner) -> None:
    def over() -> bool:
        haunting.poll()
        return not haunting.busy

    until(over)


def test_an_instant_that_is_shown_is_where_the_ghost_begins(show: Show) -> None:
    instant = instant_of(show.station)
    assert instant.at_s == 6.0
    assert instant.world == WORLD.text
    assert (instant.goal.x_m, instant.goal.y_m) == pytest.approx((5.4, 2.0))
    assert 1.5 < instant.start[0] < 3.0


def test_ended_ghost_is_drawn_and_logged(show: Show) -> None:
    haunting = haunting_of(show)
    haunting.begin("distbug")
    assert [(trail.label, trail.outcome) for trail in haunting.trails()] == [("distbug", "")]
    await_end(haunting)
    (trail,) = haunting.trails()
    assert trail.outcome == "reached"
    assert trail.path_m[0] == instant_of(show.station).start[:2]
    said = [line.text for line in show.station.log]
    assert any(text.startswith("ghost distbug: reached after ") for text in said)
    assert sum(text.startswith("ghost") for text in said) == 1


def test_from_the_beginning_the_same_navigator_drives_the_shown_run(
    drive: tuple[Recording, RunOutcome], tmp_path: Path
) -> None:
    run, outcome = drive
    show = Show(run, tmp_path, 0.0)
    haunting = haunting_of(show)
    haunting.begin("bug")
    await_end(haunting)
    show.go(1e9)
    (trail,) = haunting.trails()
    (text,) = (line.text for line in show.station.log if line.text.startswith("ghost"))
    assert text == f"ghost bug: reached after {outcome.time_s:.1f} s and {outcome.path_m:.2f} m"
    assert trail.path_m[-1] == pytest.approx(instant_of(show.station).start[:2], abs=1e-6)


def test_all_of_them_at_once_and_none_of_them(show: Show) -> None:
    haunting = GhostRunner(lambda: show.station, Ghosts(most=1))
    haunting.begin("all")
    assert len(haunting.trails()) == len(CHOICES) - 2
    haunting.begin("none")
    assert haunting.trails() == []
    assert not haunting.busy


def test_what_is_missing_is_named(drive: tuple[Recording, RunOutcome], tmp_path: Path) -> None:
    run = drive[0]
    for lacking, world, said in (
        (run, False, "the world is unknown"),
        (run.without(STATUS), True, "the robot sends no data"),
        (run.without(TRUTH, ODOMETRY), True, "the robot sends no data"),
    ):
        with pytest.raises(UserError, match=said):
            haunting_of(Show(lacking, tmp_path, 6.0, world)).begin("bug")
    with pytest.raises(UserError, match="no navigator 'vfh'"):
        haunting_of(Show(run, tmp_path, 6.0)).begin("vfh")


def test_a_robot_without_a_goal_has_no_ghosts(show: Show) -> None:
    now_ns = show.station.now_ns
    idle = standing(goal=GoalState.NONE, goal_x_m=nan, goal_y_m=nan)
    frame = Encoder(1, 1).encode(idle)
    show.station.telemetry.boxes()[STATUS.path].store(Sample(ENCODING, frame), now_ns)
    with pytest.raises(UserError, match="no goal at this instant"):
        haunting_of(show).begin("bug")


def test_outcome_is_one_line() -> None:
    stuck = PredictedPath([], "stuck", "no way", 12.34, 5.678)
    assert result_line(stuck) == "stuck after 12.3 s and 5.68 m: no way"
    assert (
        result_line(stuck._replace(reason="ok", outcome="reached"))
        == "reached after 12.3 s and 5.68 m"
    )
    assert (
        result_line(PredictedPath([], "failed", "the start is taken"))
        == "failed: the start is taken"
    )


def test_without_truth_it_begins_where_the_robot_believes_to_be(
    drive: tuple[Recording, RunOutcome], tmp_path: Path
) -> None:
    show = Show(drive[0].without(TRUTH), tmp_path, 6.0)
    assert instant_of(show.station).at_s == 0.0
    assert 1.5 < instant_of(show.station).start[0] < 3.0


def test_failed_ghost_is_logged_with_its_reason(show: Show) -> None:
    world = WORLD._replace(text=WORLD.text.replace('"size_m": [6.0, 4.0]', '"size_m": [1.0, 1.0]'))
    station = Station(show.bus, "r1", show.bus.timeline, world)
    haunting = GhostRunner(lambda: station)
    show.bus.seek(6.5)
    station.poll()
    haunting.begin("bug")
    await_end(haunting)
    assert "ghost bug: failed: " in [line.text for line in station.log][-1]


def test_ghosts_stay_on_the_map_of_a_recording_that_is_turned_back(show: Show) -> None:
    haunting = haunting_of(show)
    haunting.begin("bug")
    await_end(haunting)
    trails = haunting.trails()
    show.bus.rewind()
    show.open()
    show.go(2.0)
    haunting.poll()
    assert haunting.trails() == trails


def test_in_another_world_they_are_gone(show: Show) -> None:
    haunting = haunting_of(show)
    haunting.begin("bug")
    await_end(haunting)
    other = WORLD._replace(text=WORLD.text.replace('"box"', '"other"'))
    show.station = Station(show.bus, "r1", show.bus.timeline, other)
    haunting.poll()
    assert haunting.trails() == []


PLACES = st.floats(-2000.0, 2000.0)
TURNS = st.floats(-pi, pi)
GOALS = st.builds(
    Destination,
    x_m=PLACES,
    y_m=PLACES,
    heading_rad=st.none() | TURNS,
    position_tolerance_m=st.floats(0.001, 1.0),
    heading_tolerance_rad=st.floats(0.01, 3.14),
)
GOAL = destination([5.4, 2.0, 0.0])


@given(st.tuples(PLACES, PLACES, TURNS), st.floats(0.0, 86_400.0), GOALS)
def test_start_time_and_goal_arrive_as_they_were(
    start: tuple[float, float, float], at_s: float, goal: Destination
) -> None:
    words = trial_words(BranchPoint("box", start, at_s, goal), "bug", {"seed": 3, "side": None})
    options = parser().parse_args(numbers_kept(words[1:]))
    found, place = start_of(options.start), goal_of(options)
    assert found is not None
    assert place is not None
    assert (found.x_m, found.y_m, options.at) == (*start[:2], at_s)
    assert abs(found.heading_rad - start[2]) < 1e-10
    assert rounded_heading_rad(found.heading_rad) == rounded_heading_rad(start[2])
    again = Destination(
        x_m=place.x_m,
        y_m=place.y_m,
        heading_rad=place.heading_rad,
        position_tolerance_m=place.position_tolerance_m,
        heading_tolerance_rad=place.heading_tolerance_rad,
    )
    assert again.on_the_wire() == goal.on_the_wire()
    assert (options.navigator, options.seed, options.side) == ("bug", 3, "left")
    assert (options.trace, options.json) == ("-", True)


def test_world_is_passed_by_name_or_by_its_facts() -> None:
    named = BranchPoint("u_trap", (0.6, 2.0, 0.0), 0.0, GOAL)
    told = named._replace(world='{"name": "told"}')
    assert "u_trap" in trial_words(named, "bug", {})
    assert world_bytes(named) == b""
    assert trial_words(told, "bug", {})[trial_words(told, "bug", {}).index("--world") + 1] == "-"
    assert json.loads(world_bytes(told)) == {"name": "told"}


def test_how_a_robot_is_built_and_what_it_runs_is_not_handed_on() -> None:
    kept = driving({name: float(value) for name, value in DEFAULTS._asdict().items()})
    assert {"d_obs_m", "v_max_m_s", "guard_stop_m", "follow_m"} <= set(kept)
    assert not {"navigator", "side", "wheel_ratio", "k_r_m", "track_m"} & set(kept)


@pytest.fixture(scope="module")
def recorded_run(drive: tuple[Recording, RunOutcome]) -> Recording:
    return drive[0]


@pytest.fixture(scope="module")
def log(recorded_run: Recording, tmp_path_factory: pytest.TempPathFactory) -> str:
    return recorded_run.written(tmp_path_factory.mktemp("logs") / "20260101T000000Z-r1.tlog")


def footage(run: Recording) -> GhostRecording:
    return GhostRecording(LogIndex(run))


def test_an_instant_has_the_true_place_the_world_and_its_time(recorded_run: Recording) -> None:
    instant = footage(recorded_run).instant(6 * S, None, None)
    world = load("box")
    assert json.loads(instant.world)["name"] == "box"
    assert instant.at_s == 6.0
    assert 1.5 < instant.start[0] < 3.0
    assert (instant.goal.x_m, instant.goal.y_m) == (world.goal.x_m, world.goal.y_m)


def test_world_and_goal_may_be_others(recorded_run: Recording) -> None:
    other = destination([1.0, 1.0])
    instant = footage(recorded_run).instant(6 * S, "u_trap", other)
    assert (instant.world, instant.goal) == ("u_trap", other)


def test_the_goal_has_the_tolerances_that_it_was_asked_for_with() -> None:
    goal = GoalPose(
        x_m=2.0,
        y_m=1.0,
        heading_rad=radians(90),
        position_tolerance_m=0.2,
        heading_tolerance_rad=radians(10),
    )
    run, _ = recorded(Trial(world=replace(load("box"), goal=goal), noise="none"))
    asked = footage(run).goal_at(2 * S)
    assert (asked.position_tolerance_m, asked.heading_tolerance_rad) == (0.2, 0.174533)
    assert asked.heading_rad == pytest.approx(radians(90), abs=1e-6)
    told = footage(run.without(COMMANDED)).goal_at(2 * S)
    assert (told.x_m, told.y_m, told.position_tolerance_m) == (2.0, 1.0, 0.05)


def test_of_two_requests_for_one_place_the_one_of_that_time_counts() -> None:
    run, _ = recorded(Trial(world=load("box"), noise="none"))
    asked = wire_goal_of(load("box"))._asdict() | {"position_tolerance_mm": 500}
    run.put(COMMANDED, GoalRequest(request_id=8, mode=10, **asked), 5 * S)
    run.found.sort(key=lambda one: one.time_ns)
    told = footage(run)
    assert [told.goal_at(at_s * S).position_tolerance_m for at_s in (4, 5)] == [0.05, 0.5]


def test_the_rest_of_the_drive_is_measured_to_its_end(drive: tuple[Recording, RunOutcome]) -> None:
    run, outcome = drive
    whole, rest = footage(run).rest(0), footage(run).rest(6 * S)
    assert (whole.outcome, whole.reason, whole.time_s) == ("reached", "ok", outcome.time_s)
    assert whole.length_m == pytest.approx(outcome.path_m)
    assert rest.time_s == pytest.approx(outcome.time_s - 6.0)
    assert rest.length_m is not None
    assert rest.length_m < outcome.path_m - 1.0
    assert rest.path_m[-1] == whole.path_m[-1]


def test_truncated_recording_has_outcome_driving(recorded_run: Recording) -> None:
    half = Recording(recorded_run.facts, recorded_run.found[: len(recorded_run.found) // 2])
    assert footage(half).rest(0).outcome == "driving"


def test_without_truth_the_robots_own_belief_must_do(recorded_run: Recording) -> None:
    believed = footage(recorded_run.without(TRUTH)).instant(6 * S, None, None)
    assert believed.at_s == 0.0
    assert believed.start == pytest.approx(
        footage(recorded_run).instant(6 * S, None, None).start, abs=0.05
    )


def test_missing_data_of_a_recording_is_named(recorded_run: Recording) -> None:
    for lacking, said in (
        (recorded_run.without(STATUS), "has no status of the robot"),
        (recorded_run.without(TRUTH, ODOMETRY), "no position of the robot"),
        (Recording({}, recorded_run.found), "--world"),
        (Recording({"world": "[1]"}, recorded_run.found), "--world"),
        (Recording({"world": "{"}, recorded_run.found), "--world"),
    ):
        with pytest.raises(UserError, match=said):
            footage(lacking).instant(6 * S, None, None)
    with pytest.raises(UserError, match="no drive to a goal"):
        footage(Recording()).beginning_ns()


def test_lockstep_messages_are_matched_by_time_stamp(recorded_run: Recording) -> None:
    """Deliver the robot's status of a tick after the plant began the next tick."""
    late = Recording(
        recorded_run.facts, [one for one in recorded_run.found if not one.key.endswith(STATUS.path)]
    )
    status = [one for one in recorded_run.found if one.key.endswith(STATUS.path)]
    ticks = sorted({one.time_ns for one in recorded_run.found})
    for began_ns in ticks:
        clock = SystemTime(time_unix_usec=(began_ns - ticks[0]) // 1000, time_boot_ms=0)
        late.put(CLOCK, clock, began_ns - ticks[0])
    behind = [one._replace(time_ns=one.time_ns + 60_000_000) for one in status]
    late.found = sorted([*late.found, *behind], key=lambda one: one.time_ns)
    assert footage(late).beginning_ns() == footage(recorded_run).beginning_ns() == 0
    assert footage(late).instant(0, None, None) == footage(recorded_run).instant(0, None, None)
    assert footage(late).rest(6 * S) == footage(recorded_run).rest(6 * S)


def test_only_what_the_robot_drives_otherwise_by_is_handed_on() -> None:
    rows = [
        {"name": "d_obs_m", "value": 0.4, "default": 0.3},
        {"name": "k_omega", "value": 3.0, "default": 3.0},
        {"name": "odd"},
        {"value": 3.0},
        {"name": "worse", "value": "x"},
        7,
    ]
    assert changed_in(json.dumps(rows[:2])) == {"d_obs_m": 0.4}
    assert changed_in(json.dumps(rows)) == changed_in("nonsense") == changed_in("3") == {}


def test_the_verb_lays_the_ghosts_beside_the_real_run(
    log: str, drive: tuple[Recording, RunOutcome], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--world", "box", "--navigator", "bug", "distbug", "bug", "--json"]
    assert main(["ghost", "--from", log, *words]) == 0
    found = json.loads(capsys.readouterr().out)
    outcome = drive[1]
    assert list(found["ghosts"]) == ["bug", "distbug"]
    assert found["real"]["navigator"] == "bug"
    assert found["real"]["length_m"] == pytest.approx(outcome.path_m)
    assert found["ghosts"]["bug"]["length_m"] == pytest.approx(outcome.path_m)
    assert found["ghosts"]["bug"]["time_s"] == outcome.time_s
    assert found["ghosts"]["distbug"]["length_m"] != found["ghosts"]["bug"]["length_m"]


def test_ghost_passes_on_the_side_of_the_robot_by_default(
    tmp_path: Path, drive: tuple[Recording, RunOutcome], capsys: pytest.CaptureFixture[str]
) -> None:
    run, outcome = box("bug", side="right")
    log = run.written(tmp_path / "20260101T000000Z-r1.tlog")
    lengths_m = []
    for more in ([], ["--side", "left"]):
        words = ["--from", log, "--world", "box", "--navigator", "bug", "--json", *more]
        assert main(["ghost", *words]) == 0
        lengths_m.append(json.loads(capsys.readouterr().out)["ghosts"]["bug"]["length_m"])
    assert lengths_m == pytest.approx([outcome.path_m, drive[1].path_m])
    assert outcome.path_m != pytest.approx(drive[1].path_m)


def test_for_a_person_it_is_a_table(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--world", "box", "--at", "6", "--navigator", "vgm"]
    assert main(["ghost", "--from", log, *words]) == 0
    head, real, ghost = capsys.readouterr().out.splitlines()
    assert head.startswith("from (")
    assert "at 6 s to (5.400, 2.000)" in head
    assert real.split()[:3] == ["(real)", "bug", "reached"]
    assert ghost.split()[:2] == ["vgm", "reached"]
    assert real.index(" m") == ghost.index(" m") or len(real) == len(ghost)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--world", "box", "--at", "999"], 2, "ends at"),
        (["--world", "box", "--goal", "1"], 2, "X Y or X Y DEG"),
        (["--world", "nowhere"], 1, "no shipped world"),
        (["--world", "box", "--goal", "99", "1"], 1, "outside the world"),
        (["--world", "box", "--navigator", "vfh"], 2, "invalid choice"),
        ([], 2, "--world"),
    ],
)
def test_verb_reports_why_a_ghost_cannot_run(
    log: str, words: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ghost", "--navigator", "bug", "--from", log, *words]) == code
    told = capsys.readouterr()
    assert said in told.out + told.err


def test_a_time_needs_a_recording_and_a_ghost_a_navigator(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ghost"]) == 2
    assert main(["ghost", "--navigator", "bug", "--at", "3"]) == 2
    assert "--from" in capsys.readouterr().err
    assert main(["ghost", "--navigator", "bug", "--from", str(tmp_path / "no.tlog")]) == 2
    assert "No such file" in capsys.readouterr().err
