"""From any instant of a recording another navigator can go on, beside what really happened."""

import json
from dataclasses import replace
from math import radians
from pathlib import Path

import pytest

from ground.cli.main import main
from ground.client.goal import destination
from ground.ghost.branch_point import GhostRecording, changed_in
from ground.recording.log_reader import LogIndex
from plant.world.file import load
from protocol.outcome import Outcome
from protocol.topics import CLOCK, COMMANDED, ODOMETRY, STATUS, TRUTH
from protocol.wire.messages import GoalRequest, SystemTime
from protocol.world import GoalPose
from runtime.errors import UserError
from study.trial.trial import Trial, wire_goal_of
from tests.support.ground.recordings import Recording, box, recorded

S = 1_000_000_000


@pytest.fixture(scope="module")
def drive() -> tuple[Recording, Outcome]:
    return box("bug")


@pytest.fixture(scope="module")
def run(drive: tuple[Recording, Outcome]) -> Recording:
    return drive[0]


@pytest.fixture(scope="module")
def log(run: Recording, tmp_path_factory: pytest.TempPathFactory) -> str:
    return run.written(tmp_path_factory.mktemp("logs") / "20260101T000000Z-r1.tlog")


def footage(run: Recording) -> GhostRecording:
    return GhostRecording(LogIndex(run))


def test_an_instant_has_the_true_place_the_world_and_its_time(run: Recording) -> None:
    instant = footage(run).instant(6 * S, None, None)
    world = load("box")
    assert isinstance(instant.world, dict)
    assert instant.world["name"] == "box"
    assert instant.at_s == 6.0
    assert 1.5 < instant.start[0] < 3.0
    assert (instant.goal.x_m, instant.goal.y_m) == (world.goal.x_m, world.goal.y_m)


def test_world_and_goal_may_be_others(run: Recording) -> None:
    other = destination([1.0, 1.0])
    instant = footage(run).instant(6 * S, "u_trap", other)
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


def test_the_rest_of_the_drive_is_measured_to_its_end(drive: tuple[Recording, Outcome]) -> None:
    run, outcome = drive
    whole, rest = footage(run).rest(0), footage(run).rest(6 * S)
    assert (whole.outcome, whole.reason, whole.time_s) == ("reached", "ok", outcome.time_s)
    assert whole.length_m == pytest.approx(outcome.path_m)
    assert rest.time_s == pytest.approx(outcome.time_s - 6.0)
    assert rest.length_m is not None
    assert rest.length_m < outcome.path_m - 1.0
    assert rest.path_m[-1] == whole.path_m[-1]


def test_truncated_recording_has_outcome_driving(run: Recording) -> None:
    half = Recording(run.facts, run.found[: len(run.found) // 2])
    assert footage(half).rest(0).outcome == "driving"


def test_without_truth_the_robots_own_belief_must_do(run: Recording) -> None:
    believed = footage(run.without(TRUTH)).instant(6 * S, None, None)
    assert believed.at_s == 0.0
    assert believed.start == pytest.approx(footage(run).instant(6 * S, None, None).start, abs=0.05)


def test_missing_data_of_a_recording_is_named(run: Recording) -> None:
    for lacking, said in (
        (run.without(STATUS), "has no status of the robot"),
        (run.without(TRUTH, ODOMETRY), "no position of the robot"),
        (Recording({}, run.found), "--world"),
        (Recording({"world": "[1]"}, run.found), "--world"),
        (Recording({"world": "{"}, run.found), "--world"),
    ):
        with pytest.raises(UserError, match=said):
            footage(lacking).instant(6 * S, None, None)
    with pytest.raises(UserError, match="no drive to a goal"):
        footage(Recording()).beginning_ns()


def test_lockstep_messages_are_matched_by_time_stamp(run: Recording) -> None:
    """Deliver the robot's status of a tick after the plant began the next tick."""
    late = Recording(run.facts, [one for one in run.found if not one.key.endswith(STATUS.path)])
    status = [one for one in run.found if one.key.endswith(STATUS.path)]
    ticks = sorted({one.time_ns for one in run.found})
    for began_ns in ticks:
        clock = SystemTime(time_unix_usec=(began_ns - ticks[0]) // 1000, time_boot_ms=0)
        late.put(CLOCK, clock, began_ns - ticks[0])
    behind = [one._replace(time_ns=one.time_ns + 60_000_000) for one in status]
    late.found = sorted([*late.found, *behind], key=lambda one: one.time_ns)
    assert footage(late).beginning_ns() == footage(run).beginning_ns() == 0
    assert footage(late).instant(0, None, None) == footage(run).instant(0, None, None)
    assert footage(late).rest(6 * S) == footage(run).rest(6 * S)


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
    log: str, drive: tuple[Recording, Outcome], capsys: pytest.CaptureFixture[str]
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
    tmp_path: Path, drive: tuple[Recording, Outcome], capsys: pytest.CaptureFixture[str]
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
