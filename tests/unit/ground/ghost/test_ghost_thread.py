"""Ghosts start at the instant that a station shows, from a live robot or a recording."""

from collections.abc import Iterator
from math import nan
from pathlib import Path

import pytest

from ground.ghost.branch_point import PredictedPath
from ground.ghost.ghost import CHOICES, GhostRunner, Ghosts, instant_of, result_line
from ground.station.station import Station
from protocol.bus.mailbox import Sample
from protocol.outcome import Outcome
from protocol.topics import ENCODING, ODOMETRY, STATUS, TRUTH
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState
from runtime.errors import UserError
from tests.support.ground.explain.decisions import standing
from tests.support.ground.recordings import Recording, box
from tests.support.ground.shown import WORLD, Show
from tests.support.until import until


@pytest.fixture(scope="module")
def drive() -> tuple[Recording, Outcome]:
    return box("bug")


@pytest.fixture
def show(drive: tuple[Recording, Outcome], tmp_path: Path) -> Iterator[Show]:
    shown = Show(drive[0], tmp_path, 6.0)
    yield shown
    shown.station.close()


def haunting_of(show: Show) -> GhostRunner:
    return GhostRunner(lambda: show.station)


def ended(haunting: GhostRunner) -> None:
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
    ended(haunting)
    (trail,) = haunting.trails()
    assert trail.outcome == "reached"
    assert trail.path_m[0] == instant_of(show.station).start[:2]
    said = [line.text for line in show.station.log]
    assert any(text.startswith("ghost distbug: reached after ") for text in said)
    assert sum(text.startswith("ghost") for text in said) == 1


def test_from_the_beginning_the_same_navigator_drives_the_shown_run(
    drive: tuple[Recording, Outcome], tmp_path: Path
) -> None:
    run, outcome = drive
    show = Show(run, tmp_path, 0.0)
    haunting = haunting_of(show)
    haunting.begin("bug")
    ended(haunting)
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


def test_what_is_missing_is_named(drive: tuple[Recording, Outcome], tmp_path: Path) -> None:
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
    drive: tuple[Recording, Outcome], tmp_path: Path
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
    ended(haunting)
    assert "ghost bug: failed: " in [line.text for line in station.log][-1]


def test_ghosts_stay_on_the_map_of_a_recording_that_is_turned_back(show: Show) -> None:
    haunting = haunting_of(show)
    haunting.begin("bug")
    ended(haunting)
    trails = haunting.trails()
    show.bus.rewind()
    show.open()
    show.go(2.0)
    haunting.poll()
    assert haunting.trails() == trails


def test_in_another_world_they_are_gone(show: Show) -> None:
    haunting = haunting_of(show)
    haunting.begin("bug")
    ended(haunting)
    other = WORLD._replace(text=WORLD.text.replace('"box"', '"other"'))
    show.station = Station(show.bus, "r1", show.bus.timeline, other)
    haunting.poll()
    assert haunting.trails() == []
