"""Encounters of a trial: nearness, contacts, and what the robot knew of the person."""

from math import inf, isclose

from protocol.world import Circle, GoalPose, Start, World
from robot.core.perception.people import PROVEN, People
from study.people.encounters import (
    PERSONAL_M,
    SOON_S,
    STEP_S,
    Encounters,
    Exposure,
    Walker,
    tracked,
)
from study.trial.trial import Trial, run_trial

BEHIND = Circle(x_m=0.5, y_m=1.5, radius_m=0.2, path_m=((0.5, 1.5), (3.5, 1.5)), speed_m_s=0.4)
TOUCHING_M = 0.32
STILL_M_S = (0.0, 0.0)


def world(*people: Circle) -> World:
    return World(
        name="way",
        size_m=(5.0, 3.0),
        start=Start(x_m=1.0, y_m=1.5),
        goal=GoalPose(x_m=3.0, y_m=1.5),
        obstacles=people,
    )


def walker(x_m: float, speed_m_s: float = 0.0) -> Walker:
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
        exposure.add((0.0, 0.0), STILL_M_S, [walker(edge_m + 0.01), walker(3.0)]),
        exposure.add((0.0, 0.0), STILL_M_S, [walker(3.0), walker(edge_m - 0.01)]),
        exposure.add((0.0, 0.0), STILL_M_S, [walker(TOUCHING_M + 0.2 * SOON_S + 0.01, 0.2)]),
        exposure.add((0.0, 0.0), STILL_M_S, [walker(TOUCHING_M + 0.2 * SOON_S - 0.01, 0.2)]),
    ]
    assert [index for _, index in nearest] == [0, 1, 0, 0]
    assert (exposure.ticks, exposure.person_ticks) == (4, 6)
    assert (exposure.intruded_ticks, exposure.soon_ticks) == (3, 1)
    assert abs(exposure.least_s - (SOON_S - 0.05)) < 1e-9
    assert exposure.time_s == 4 * STEP_S


def test_only_a_proven_track_near_a_person_counts() -> None:
    tracks, people = People(), [walker(1.0), walker(2.0)]
    tracks.x_m[1], tracks.left[1], tracks.proof[1] = 2.1, 5, PROVEN
    assert tracked(tracks, people) == []
    tracks.any = True
    assert tracked(tracks, people) == [1]
    tracks.proof[1] = PROVEN - 1
    assert tracked(tracks, people) == []
    tracks.proof[1], tracks.left[1] = PROVEN, 0
    assert tracked(tracks, people) == []
