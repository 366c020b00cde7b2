"""Encounters of a trial, and the table of a comparison."""

from plant.model.types import Circle, GoalPose, Start, World
from study.people.comparison import COLUMNS, compare, table
from study.people.encounters import PERSONAL_M, Encounters
from study.trial.trial import Trial, run_trial

BEHIND = Circle(x_m=0.5, y_m=1.5, radius_m=0.2, path_m=((0.5, 1.5), (3.5, 1.5)), speed_m_s=0.4)


def world(*people: Circle) -> World:
    return World(
        name="way",
        size_m=(5.0, 3.0),
        start=Start(x_m=1.0, y_m=1.5),
        goal=GoalPose(x_m=3.0, y_m=1.5),
        obstacles=people,
    )


def test_empty_floor_has_no_encounters() -> None:
    place = world()
    encounters = Encounters(place)
    outcome = run_trial(Trial(world=place, noise="none"), encounters)
    assert outcome.reached
    assert encounters.ticks == outcome.ticks + 1
    assert (encounters.intruded_s, encounters.soon_s, encounters.person_s) == (0.0, 0.0, 0.0)


def test_person_from_behind_is_a_contact_that_is_not_own() -> None:
    place = world(BEHIND)
    encounters = Encounters(place)
    outcome = run_trial(Trial(world=place, noise="none"), encounters)
    assert (outcome.contacts, outcome.own_contacts) == (1, 0)
    (contact,) = encounters.contacts
    assert contact.person == 0
    assert abs(contact.bearing_rad) > 2.5
    assert encounters.intruded_s == encounters.time_s
    assert encounters.least_s < 0.1


def test_person_beyond_the_personal_space_does_not_intrude() -> None:
    far = Circle(x_m=4.5, y_m=0.3, radius_m=0.2, path_m=((4.5, 0.3), (4.5, 0.4)), speed_m_s=0.05)
    place = world(far)
    encounters = Encounters(place)
    run_trial(Trial(world=place, noise="none"), encounters)
    assert PERSONAL_M < 1.0
    assert encounters.intruded_s == 0.0
    assert encounters.person_s == encounters.time_s > 0.0


def test_comparison_adds_up_trials_and_prints_a_row() -> None:
    found = compare([world(BEHIND), world()], "way", "vgm_memory", "none")
    assert (found.trials, found.touched, found.own, found.untouched) == (2, 1, 0, 1)
    assert 0.0 < found.standing <= 1.0
    assert found.blocked == 1
    lines = table([found]).splitlines()
    assert len(lines) == 3
    assert all(line.count("|") == len(COLUMNS) + 1 for line in lines)
    assert "50.0 %" in lines[2]
