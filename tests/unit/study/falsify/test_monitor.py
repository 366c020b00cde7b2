"""The monitor: the last lap of a proof, and the first contact, in real drives."""

from dataclasses import replace
from functools import cache
from math import inf, pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from protocol.wire.messages import GroundTruth
from protocol.world import Circle, GoalPose, Obstacle, Polyline, Start, World
from robot.core.navigators import proof as proofs
from study.falsify.evaluate import Monitor, Subject, evaluate, nearest_thing, sonar_towards
from study.falsify.findings import read_finding, sentence_of
from study.falsify.properties import Evaluation
from study.trial.core_loop import CoreLoop
from tests.support.each import each

FIXED = Path(__file__).parents[4] / "study" / "falsify" / "worlds" / "fixed"
WALL = Polyline(((2.0, 1.0), (2.0, 3.0)), 0.1)
POST = Circle(x_m=3.0, y_m=3.5, radius_m=0.2)
PERSON = Circle(x_m=1.0, y_m=3.0, radius_m=0.2, path_m=((1.0, 3.0), (3.0, 3.0)), speed_m_s=0.5)


def world_of(*obstacles: Obstacle) -> World:
    return World(
        name="w",
        size_m=(4.0, 4.0),
        start=Start(x_m=0.5, y_m=0.5),
        goal=GoalPose(x_m=3.0, y_m=1.0),
        obstacles=obstacles,
    )


def truth_at(x_m: float, y_m: float, heading_rad: float = 0.0, time_s: float = 0.0) -> GroundTruth:
    return GroundTruth(
        time_ns=round(time_s * 1e9),
        seq=0,
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        speed_m_s=0.0,
        yaw_rate_rad_s=0.0,
        clearance_m=0.0,
        contact=1,
    )


@cache
def contact() -> Evaluation:
    """Drive the paper's Bug into the end of a wall that it sees too late."""
    finding = read_finding(FIXED / "c-symmetric_trap-contact-passing.toml")
    subject = replace(finding.subject, navigator="bug")
    return replace(finding, subject=subject, limit_s=30.0).replay()


@cache
def claim() -> Evaluation:
    """Drive round a closed room of 1.5 m by 1.5 m that holds the goal."""
    room = Polyline(((2.0, 1.0), (3.5, 1.0), (3.5, 2.5), (2.0, 2.5), (2.0, 1.0)), 0.1)
    world = replace(world_of(room), goal=GoalPose(x_m=2.75, y_m=1.75), reachable=False)
    subject = Subject(navigator="vgm_memory", side="left", noise="none", detour=20.0)
    return evaluate(subject, world, 0, 400.0)


@each(
    ("truth", "name", "bearing_rad"),
    [
        (truth_at(1.8, 2.0), "wall 1", 0.0),
        (truth_at(1.8, 2.0, pi / 2.0), "wall 1", -pi / 2.0),
        (truth_at(2.0, 0.8), "the end of wall 1", pi / 2.0),
        (truth_at(3.3, 3.5), "post 2", -pi),
        (truth_at(1.3, 3.0), "person 3", -pi),
        (truth_at(3.5, 3.0, time_s=4.0), "person 3", -pi),
        (truth_at(0.1, 2.0), "the outer wall", -pi),
    ],
)
def test_nearest_thing_has_name_and_bearing(
    truth: GroundTruth, name: str, bearing_rad: float
) -> None:
    found = nearest_thing(world_of(WALL, POST, PERSON), truth)
    assert found[0] == name
    assert found[1] == pytest.approx(bearing_rad)


def test_closed_wall_has_no_end() -> None:
    closed = Polyline(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 1.0)))
    assert nearest_thing(world_of(closed), truth_at(0.9, 1.0))[0] == "wall 1"


def test_no_sonar_points_behind_the_robot() -> None:
    assert [sonar_towards(bearing_rad) for bearing_rad in (-1.5, 0.1, 1.5)] == [0, 4, 7]
    assert sonar_towards(1.6) is sonar_towards(pi) is None


def test_contact_has_speed_and_last_echo() -> None:
    found = contact().contact
    assert found is not None
    assert found.touched == "the end of wall 1"
    assert 0.05 < found.speed_m_s <= 0.5
    assert found.is_in_view
    assert found.range_m is not None
    assert 0.0 < found.range_m < inf
    assert found.age_s is not None
    assert 0.05 <= found.age_s < 1.0  # a tick before the contact, or earlier
    sentence = sentence_of("c", "bug", contact())
    assert f"bug touches the end of wall 1 at {found.speed_m_s:.2f} m/s" in sentence
    assert f"last measured {found.range_m:.2f} m, {found.age_s:.2f} s before" in sentence


def test_contact_out_of_view_is_told_from_one_without_echo() -> None:
    made = contact().contact
    assert made is not None
    behind = replace(contact(), contact=made._replace(is_in_view=False))
    assert "where no sonar points" in sentence_of("c", "bug", behind)
    silent = replace(contact(), contact=made._replace(range_m=None, age_s=None))
    assert "had measured no echo" in sentence_of("c", "bug", silent)
    assert "touches something" in sentence_of("c", "bug", replace(contact(), contact=None))


def test_claim_has_the_last_lap_and_the_doubt() -> None:
    result = claim()
    assert result.kind == "claim"
    assert result.lap is not None
    # The way round the room at a few centimetres from it is longer than its four sides.
    assert 6.0 < result.lap.length_m < 1.5 * 6.0
    assert result.outcome.doubt_m is not None
    assert (
        f"with a lap of {result.lap.length_m:.1f} m with no gap in the chain of echoes and a"
        f" position doubt of {result.outcome.doubt_m:.2f} m"
    ) in sentence_of("b", "vgm_memory", result)


def test_gaps_of_a_lap_are_counted_until_the_next_mark() -> None:
    monitor, proof = Monitor(), proofs.Proof()
    onboard = cast("CoreLoop", SimpleNamespace(state=SimpleNamespace(memory=holder_of(proof))))
    hop = (proofs.WAITING, proofs.HOPPED)
    for way_mm, gap in enumerate((proofs.NO_GAP, *hop, proofs.HOPPED, *hop), 1):
        proof.way_mm, proof.gap = way_mm, gap
        monitor._watch_lap(onboard)
    assert monitor.lap == (0.006, 2)
    proof.way_mm, proof.gap = 2, proofs.NO_GAP
    monitor._watch_lap(onboard)
    assert monitor.lap == (0.002, 0)


def test_navigator_without_proofs_has_no_lap() -> None:
    assert contact().lap is None


def holder_of(proof: proofs.Proof) -> Any:
    return SimpleNamespace(proof=proof)
