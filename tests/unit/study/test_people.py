"""Trials among people: encounters, baselines, rates, and the page."""

import json
from itertools import pairwise
from math import inf, isclose, pi
from multiprocessing.pool import ThreadPool
from pathlib import Path

import pytest

from protocol.world import Point, Polyline, World, WorldCircle
from robot.core.perception.people import PROVEN, People
from runtime.units import PERIOD_S
from study.people import __main__ as command
from study.people.__main__ import BEGIN, CONTACTS, END, NAVIGATORS, to_json, with_tables
from study.people.comparison import (
    CrowdComparison,
    Rate,
    contact_table,
    navigator_table,
    origin_table,
    poisson_interval,
    pooled,
)
from study.people.crowd_trial import (
    CELL_M,
    LAYER_S,
    CrowdTrial,
    Stay,
    TrialSeries,
    WorldResult,
    omniscient_route,
    places_along,
    route_exposure,
    run_world,
    stand,
    stay,
)
from study.people.encounters import (
    PERSONAL_M,
    SOON_S,
    Encounters,
    Exposure,
    PersonContact,
    Walker,
    time_to_collision_s,
    tracked,
)
from study.trial.trial import Trial, run_trial
from tests.support.each import each
from tests.support.pages import ROOT
from tests.support.plant import plain_world

BUG, MEMORY = "bug:right", "vgm_memory:left"
SERIES = TrialSeries("crowd", "default", 5, 4, (BUG, MEMORY))
HOUR_TICKS = 72_000
EXPOSURE = Exposure(HOUR_TICKS, HOUR_TICKS, HOUR_TICKS // 10, HOUR_TICKS // 20, 1.5)


def contact(
    bearing_rad: float, speed_m_s: float, yaw_rad_s: float, tracked_s: float, person_m_s: float
) -> PersonContact:
    return PersonContact(1.0, 0, bearing_rad, speed_m_s, yaw_rad_s, tracked_s, person_m_s)


def trial(touched: bool, standing: float, own: int = 0, *contacts: PersonContact) -> CrowdTrial:
    return CrowdTrial(not touched, touched, own, standing, EXPOSURE, contacts)


def result(*trials: CrowdTrial, blocked: bool = False) -> WorldResult:
    stays = (Stay(EXPOSURE, True), Stay(EXPOSURE, False))
    return WorldResult({BUG: trials, MEMORY: trials}, blocked, stays, None if blocked else EXPOSURE)


def comparison(*results: WorldResult) -> CrowdComparison:
    return CrowdComparison((SERIES,), MEMORY, results)


def test_comparison_counts_trials_and_rates() -> None:
    found = comparison(
        result(trial(True, 0.5, 1)),
        result(trial(False, 0.25)),
        result(trial(False, 0.25)),
        result(trial(False, 0.0), blocked=True),
    )
    assert (found.arrived.count, found.touched.count, found.own.count) == (3, 1, 1)
    assert (found.blocked.count, found.blocked.of) == (1, 4)
    assert found.standing == 0.25
    assert found.excess == 0.125
    assert found.own_rate.per_hour == 0.25
    assert isclose(found.nearness.intruded_s_per_min, 6.0)
    assert isclose(found.nearness.soon_share, 0.05)


@each(("touched", "verdict"), [(0, "met"), (10, "not decided"), (40, "missed")])
def test_verdict_needs_the_whole_interval_on_one_side(touched: int, verdict: str) -> None:
    results = [result(trial(number < touched, 0.3)) for number in range(100)]
    assert comparison(*results).verdict == verdict


def test_repeated_trials_of_a_world_are_one_sample() -> None:
    single = [result(trial(touched, 0.5)) for touched in (True, False) * 20]
    repeated = [result(*[trial(touched, 0.5)] * 4) for touched in (True, False) * 20]
    low, high = comparison(*single).excess_interval
    assert low < comparison(*single).excess < high
    assert comparison(*repeated).excess_interval == (low, high)
    few_low, few_high = comparison(*repeated).touched.interval
    assert comparison(*repeated).touched_interval.low < few_low
    assert comparison(*repeated).touched_interval.high > few_high


def test_pooled_comparison_has_the_worlds_of_both() -> None:
    one, other = comparison(result(trial(True, 0.5))), comparison(result(trial(False, 0.1)))
    both = pooled(one, other)
    assert (both.touched.count, len(both.results)) == (1, 2)
    assert isclose(both.standing, 0.3)
    assert "| seed of the worlds | 5 and 5 |" in contact_table([both])


def test_tables_have_equal_columns_in_every_row() -> None:
    found = comparison(result(trial(True, 0.5)), result(trial(False, 0.5), blocked=True))
    rows = [CrowdComparison((SERIES,), BUG, found.results), found]
    for table in (contact_table(rows), navigator_table(rows), origin_table(rows)):
        lines = table.splitlines()
        assert len({line.count("|") for line in lines}) == 1
    names = [line.split(" | ")[0] for line in navigator_table(rows).splitlines()[2:]]
    assert names == ["| bug, right", "| vgm_memory", "| standing robot", "| omniscient robot"]


def test_origin_table_sorts_contacts_by_bearing_motion_and_track() -> None:
    found = comparison(
        result(trial(True, 0.5, 0, contact(pi, 0.3, 0.0, 0.0, 0.31))),
        result(trial(True, 0.5, 0, contact(-0.6 * pi, 0.0, -1.0, 3.0, 0.29))),
        result(trial(True, 0.5, 1, contact(-0.1, 0.2, 0.0, inf, 0.4))),
        result(trial(True, 0.5, 0, contact(1.0, 0.0, 0.0, 6.5, 0.1))),
    )
    cells = [line.strip("| ").split(" | ")[2:] for line in origin_table([found]).splitlines()[2:]]
    assert cells == [
        ["2", "0", "1", "1", "0", "1", "1", "0", "1"],
        ["1", "0", "0", "0", "1", "0", "0", "1", "0"],
        ["1", "1", "1", "0", "0", "0", "0", "1", "1"],
        ["4", "1", "2", "1", "1", "1", "1", "2", "2"],
    ]


def test_page_keeps_its_text_and_gets_new_tables() -> None:
    marks = BEGIN.format("contacts") + "old\n" + END.format("contacts")
    page = with_tables(f"before\n{marks}after\n", {"contacts": "new\n"})
    assert page.startswith("before\n")
    assert page.endswith("after\n")
    assert "new" in page
    assert "old" not in page
    assert with_tables(page, {"contacts": "new\n"}) == page


def test_page_without_marks_is_refused() -> None:
    with pytest.raises(ValueError, match=r"has no <!-- begin: python -m study\.people, contacts"):
        with_tables("text\n", {"contacts": "new\n"})


def test_json_counts_the_baselines_per_trial() -> None:
    series = SERIES._replace(repeats=2)
    results = (
        result(trial(True, 0.75, 1), trial(False, 0.75), blocked=True),
        result(trial(False, 0.25), trial(False, 0.25)),
    )
    found = CrowdComparison((series,), MEMORY, results)
    (counts,) = json.loads(to_json([found], []))["crowds"]
    assert counts == {
        "family": "crowd",
        "navigator": "vgm_memory",
        "noise": "default",
        "seed": 5,
        "trials": 4,
        "touched": 1,
        "own": 1,
        "standing_touched": 2,
        "omniscient_touched": 2,
    }


def test_world_is_driven_by_each_navigator_with_its_baselines() -> None:
    series = TrialSeries("crowd", "none", 7, 1, ("bug2:left", MEMORY), is_exposed=True)
    found = run_world(series, 0)
    assert [len(trials) for trials in found.trials.values()] == [1, 1]
    (one,) = found.trials[MEMORY]
    assert one.arrived != one.touched
    assert found.blocked == (found.route is None)
    longest_s = max(one.exposure.time_s for one in found.stays)
    assert isclose(longest_s, one.exposure.time_s, abs_tol=0.06)


BEHIND = WorldCircle(x_m=0.5, y_m=1.5, radius_m=0.2, path_m=((0.5, 1.5), (3.5, 1.5)), speed_m_s=0.4)
TOUCHING_M = 0.32
STILL_M_S = (0.0, 0.0)


def world(*people: WorldCircle) -> World:
    return plain_world("way", (5.0, 3.0), (1.0, 1.5), (3.0, 1.5), *people)


def walker_met(x_m: float, speed_m_s: float = 0.0) -> Walker:
    """Return a person ahead that comes nearer."""
    return Walker((x_m, 0.0), (-speed_m_s, 0.0), TOUCHING_M)


def test_empty_floor_has_no_encounters() -> None:
    place = world()
    encounters = Encounters(place)
    outcome = run_trial(Trial(world=place, noise="none"), encounters)
    exposure = encounters.exposure
    assert outcome.reached
    assert exposure.ticks == outcome.ticks + 1
    assert (exposure.intruded_s, exposure.soon_s, exposure.person_s) == (0.0, 0.0, 0.0)


def test_person_from_behind_is_a_contact_that_is_not_own() -> None:
    place = world(BEHIND)
    encounters = Encounters(place)
    outcome = run_trial(Trial(world=place, noise="none"), encounters)
    assert (outcome.contacts, outcome.own_contacts) == (1, 0)
    (contact,) = encounters.contacts
    assert contact.person == 0
    assert abs(contact.bearing_rad) > 2.5
    assert contact.tracked_s == inf
    assert isclose(contact.person_m_s, 0.4)
    assert encounters.exposure.intruded_s == encounters.exposure.time_s
    assert encounters.exposure.least_s < 0.1


def test_exposure_counts_only_nearness_below_the_limits() -> None:
    exposure = Exposure()
    edge_m = TOUCHING_M + PERSONAL_M
    nearest = [
        exposure.add((0.0, 0.0), STILL_M_S, [walker_met(edge_m + 0.01), walker_met(3.0)]),
        exposure.add((0.0, 0.0), STILL_M_S, [walker_met(3.0), walker_met(edge_m - 0.01)]),
        exposure.add((0.0, 0.0), STILL_M_S, [walker_met(TOUCHING_M + 0.2 * SOON_S + 0.01, 0.2)]),
        exposure.add((0.0, 0.0), STILL_M_S, [walker_met(TOUCHING_M + 0.2 * SOON_S - 0.01, 0.2)]),
    ]
    assert [index for _, index in nearest] == [0, 1, 0, 0]
    assert (exposure.ticks, exposure.person_ticks) == (4, 6)
    assert (exposure.intruded_ticks, exposure.soon_ticks) == (3, 1)
    assert abs(exposure.least_s - (SOON_S - 0.05)) < 1e-9
    assert exposure.time_s == 4 * PERIOD_S


def test_only_a_proven_track_near_a_person_counts() -> None:
    tracks, people = People(), [walker_met(1.0), walker_met(2.0)]
    tracks.x_m[1], tracks.left[1], tracks.proof[1] = 2.1, 5, PROVEN
    assert tracked(tracks, people) == []
    tracks.any = True
    assert tracked(tracks, people) == [1]
    tracks.proof[1] = PROVEN - 1
    assert tracked(tracks, people) == []
    tracks.proof[1], tracks.left[1] = PROVEN, 0
    assert tracked(tracks, people) == []


def floor_with(*obstacles: WorldCircle | Polyline) -> World:
    """Return 4 by 2 m with a straight way of 3 m through its middle."""
    return plain_world("crossing", (4.0, 2.0), (0.5, 1.0), (3.5, 1.0), *obstacles)


def walker(speed_m_s: float, *path: Point) -> WorldCircle:
    return WorldCircle(
        x_m=path[0][0], y_m=path[0][1], radius_m=0.2, path_m=path, speed_m_s=speed_m_s
    )


def omniscient_s(world: World) -> float | None:
    route = omniscient_route(world, 60.0)
    return None if route is None else LAYER_S * (len(route) - 1)


def test_places_divide_the_shortest_path_evenly() -> None:
    places = places_along(floor_with(), 3)
    assert [round(x_m, 6) for x_m, _ in places] == [1.0, 2.0, 3.0]
    assert all(isclose(y_m, 1.0) for _, y_m in places)


def test_standing_robot_is_touched_at_every_passage() -> None:
    world = floor_with(walker(0.2, (2.0, 1.7), (2.0, 0.3)))
    assert stand(world, [(2.0, 1.0)], 1.0)[0].contacts == 0
    assert stand(world, [(2.0, 1.0)], 7.0)[0].contacts == 1
    assert stand(world, [(2.0, 1.0)], 14.0)[0].contacts == 2
    assert stand(world, [(1.0, 1.0)], 14.0)[0].contacts == 0


def test_standing_robot_is_not_touched_by_a_person_on_it() -> None:
    world = floor_with(walker(0.2, (2.0, 1.0), (2.0, 0.3)))
    assert stand(world, [(2.0, 1.0)], 3.0)[0].contacts == 0


def test_stay_ends_at_its_first_contact() -> None:
    world = floor_with(walker(0.2, (2.0, 1.7), (2.0, 0.3)))
    touched, free = stay(world, (2.0, 1.0), 14.0), stay(world, (1.0, 1.0), 14.0)
    assert touched.touched
    assert isclose(touched.exposure.time_s, (0.7 - 0.32) / 0.2, abs_tol=0.11)
    assert touched.exposure.least_s < 0.1
    assert not free.touched
    assert isclose(free.exposure.time_s, 14.05)
    assert free.exposure.least_s == inf


def test_stay_begins_when_the_person_there_has_left() -> None:
    world = floor_with(walker(0.2, (2.0, 1.0), (2.0, 0.3)))
    found = stay(world, (2.0, 1.0), 3.0)
    assert not found.touched
    assert isclose(found.exposure.time_s, 3.0 - 0.32 / 0.2, abs_tol=0.11)


def test_omniscient_route_is_connected_and_avoids_the_person() -> None:
    world = floor_with(walker(0.2, (2.0, 1.7), (2.0, 0.3)))
    route = omniscient_route(world, 60.0)
    assert route is not None
    assert isclose(route[0][0], 0.5, abs_tol=CELL_M)
    assert isclose(route[-1][0], 3.5, abs_tol=CELL_M)
    assert all(
        abs(bx - ax) < 1.01 * CELL_M and abs(by - ay) < 1.01 * CELL_M
        for (ax, ay), (bx, by) in pairwise(route)
    )
    exposure = route_exposure(world, route)
    assert isclose(exposure.time_s, LAYER_S * (len(route) - 1))
    assert exposure.least_s > 0.0
    assert 0 < exposure.intruded_ticks < exposure.ticks


def test_omniscient_robot_takes_the_straight_way_on_free_floor() -> None:
    time_s = omniscient_s(floor_with())
    assert time_s is not None
    assert 2.8 / 0.3 < time_s < 3.0 / 0.2


def test_omniscient_robot_waits_for_a_person_in_a_gate() -> None:
    gate = [
        Polyline(((2.0, 0.0), (2.0, 0.6))),
        Polyline(((2.0, 1.4), (2.0, 2.0))),
    ]
    free_s = omniscient_s(floor_with(*gate))
    person = walker(0.03, (2.0, 1.0), (2.5, 1.0), (3.3, 0.4))
    later_s = omniscient_s(floor_with(*gate, person))
    assert free_s is not None
    assert later_s is not None
    assert later_s > free_s


def test_omniscient_robot_finds_no_way_where_it_must_be_touched() -> None:
    walls = [Polyline(((0.0, y_m), (4.0, y_m))) for y_m in (0.7, 1.3)]
    person = walker(0.2, (3.4, 1.0), (0.4, 1.0))
    assert omniscient_s(floor_with(*walls, person)) is None


def test_time_to_collision_is_that_of_two_discs() -> None:
    person = Walker((2.0, 0.0), (-0.2, 0.0), 0.32)
    assert isclose(time_to_collision_s((0.0, 0.0), (0.3, 0.0), person), 1.68 / 0.5)
    assert time_to_collision_s((0.0, 0.4), (0.3, 0.0), person) == inf
    assert time_to_collision_s((0.0, 0.0), (-0.3, 0.0), person) == inf
    assert time_to_collision_s((1.9, 0.0), (0.3, 0.0), person) == 0.0


MARKS = ("contacts", "crowd", "crowd_hasty", "origins")


def table_in(page: str, name: str) -> list[str]:
    text = page.partition(BEGIN.format(name))[2].partition(END.format(name))[0]
    return [line for line in text.splitlines() if line.startswith("|")]


def test_command_fills_every_table_of_the_committed_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts = [series._replace(worlds=1, repeats=1) for series in CONTACTS]
    navigators = [series._replace(worlds=1, navigators=("bug2:left",)) for series in NAVIGATORS]
    monkeypatch.setattr(command, "CONTACTS", contacts)
    monkeypatch.setattr(command, "NAVIGATORS", navigators)
    page, counts = tmp_path / "people.md", tmp_path / "people.json"
    page.write_text((ROOT / command.PAGE).read_text(encoding="utf-8"), encoding="utf-8")
    with ThreadPool(1) as workers:
        command.write_page(workers, page, counts)
    text = page.read_text(encoding="utf-8")
    assert all(len(table_in(text, name)) > 3 for name in MARKS)
    assert table_in(text, "contacts")[0].count("crowd") == 8
    assert "| worlds | 1 | 1 | 2 | 1 | 1 | 1 | 2 | 1 | 1 |" in table_in(text, "contacts")
    found = json.loads(counts.read_text(encoding="utf-8"))
    assert [one["noise"] for one in found["crowds"]] == [one.noise for one in CONTACTS]
    assert [one["navigator"] for one in found["navigators"]] == ["bug2", "bug2"]


def test_other_worlds_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--family", "crowd", "--worlds", "1", "--noise", "none", "--processes", "1"]
    assert command.main(arguments) == 0
    printed = capsys.readouterr().out
    assert "| navigator | vgm_memory |" in printed
    assert "\n| omniscient robot |" in printed


def test_unknown_navigator_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--family", "crowd", "--navigator", "bug3", "--processes", "1"]
    assert command.main(arguments) == 2
    assert "bug3" in capsys.readouterr().err


def test_series_of_one_world_runs_once_for_each_navigator() -> None:
    series = TrialSeries("crowd", "none", 7, 1, ("bug2:left", "vgm_memory:left"), is_exposed=True)
    with ThreadPool(1) as workers:
        first, second = command.run(workers, series)
    assert (first.navigator, second.navigator) == series.navigators
    assert len(first.trials) == len(second.trials) == 1


@each(
    ("count", "low", "high"),
    [(0, 0.0, 3.6889), (1, 0.0253, 5.5716), (3, 0.6187, 8.7673), (10, 4.7954, 18.3904)],
)
def test_poisson_interval_equals_published_values(count: int, low: float, high: float) -> None:
    found = poisson_interval(count)
    assert isclose(found.low, low, abs_tol=1e-4)
    assert isclose(found.high, high, abs_tol=1e-4)


def test_rate_divides_events_and_interval_by_hours() -> None:
    rate = Rate(3, 2.0)
    assert rate.per_hour == 1.5
    assert isclose(rate.interval.high, poisson_interval(3).high / 2.0)


def test_rate_without_time_is_unknown() -> None:
    assert Rate(0, 0.0).interval == (0.0, float("inf"))
