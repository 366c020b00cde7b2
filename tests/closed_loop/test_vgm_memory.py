"""vgm_memory in the real plant: goals are reached, or found to be unreachable."""

from collections.abc import Iterator
from pathlib import Path
from time import process_time

import pytest

from plant.corpus import FAMILIES
from plant.world.file import load
from protocol.outcome import Outcome
from protocol.wire.reasons import Reason, reason_text
from protocol.world import World
from study.trial.core_loop import Behaviour
from study.trial.trial import Trial, run_trial

FIXED = sorted((Path(__file__).parents[2] / "plant" / "corpus" / "fixed").glob("*.toml"))
SHIPPED = ("u_trap", "zigzag", "corridor", "corner", "forest_dense", "door")
MOST_SIDE_CHANGES = 5
# Walls from alternate sides demand a change each (zigzag: three), so these may have twice as many.
WINDING = ("zigzag", "maze", "thin")
MOST_CPU_S = 25.0
LONG_S = 1200.0


@pytest.fixture(autouse=True)
def _bounded_cost() -> Iterator[None]:
    begun_s = process_time()
    yield
    assert process_time() - begun_s < MOST_CPU_S


def run(world: World, noise: str, seed: int = 3) -> tuple[Outcome, Behaviour]:
    trial = Trial(world=world, navigator="vgm_memory", noise=noise, seed=seed, timeout_s=LONG_S)
    behaviour = Behaviour()
    return run_trial(trial, behaviour), behaviour


def most_side_changes(world: World) -> int:
    winding = world.name in WINDING or world.family in WINDING
    return 2 * MOST_SIDE_CHANGES if winding else MOST_SIDE_CHANGES


@pytest.mark.sweep(3)
@pytest.mark.parametrize("noise", ["none", "default"])
@pytest.mark.parametrize("name", SHIPPED)
def test_traps_and_narrow_places_are_passed_without_contact(name: str, noise: str) -> None:
    world = load(name)
    outcome, behaviour = run(world, noise)
    assert (outcome.outcome, outcome.contacts) == ("reached", 0)
    assert outcome.min_clearance_m > 0.02
    assert behaviour.side_changes <= most_side_changes(world)


def test_every_family_has_its_worlds_here() -> None:
    assert {load(str(path)).family for path in FIXED} == set(FAMILIES)


SHUT = [path for path in FIXED[::-1] if load(str(path)).reachable is False]


@pytest.mark.sweep(3)
@pytest.mark.parametrize("path", [path for path in FIXED if path not in SHUT], ids=lambda p: p.stem)
def test_reachable_goals_are_reached(path: Path) -> None:
    world = load(str(path))
    outcome, behaviour = run(world, "default")
    if world.family == "moving":  # a pedestrian may still run into the robot, which ends the run
        assert outcome.own_contacts == 0
        assert outcome.outcome == "reached" or outcome.contacts > 0
        return
    assert outcome.contacts == 0
    assert outcome.outcome == "reached"
    assert behaviour.side_changes <= most_side_changes(world)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("path", SHUT, ids=lambda path: path.stem)
def test_most_goals_without_a_way_are_proved_unreachable(path: Path) -> None:
    """The study has the share; with default noise one drive in fifty finds no proof in time."""
    outcomes = [run(load(str(path)), "default", seed)[0] for seed in (3, 4, 5)]
    proved = [one for one in outcomes if one.outcome == "unreachable"]
    assert len(proved) >= 2
    assert {one.reason for one in proved} == {reason_text(Reason.UNREACHABLE)}
    assert [one.contacts for one in outcomes] == [0, 0, 0]
    assert {one.outcome for one in outcomes} <= {"unreachable", "lost", "timeout"}


@pytest.mark.sweep(2)
@pytest.mark.parametrize("noise", ["none", "default", "lossy"])
def test_crossing_pedestrians_are_not_hit_by_the_robot(noise: str) -> None:
    world = load("moving")
    for seed in range(4):
        outcome, behaviour = run(world, noise, seed)
        assert outcome.own_contacts == 0
        assert outcome.outcome == "reached" or outcome.contacts > 0
        assert behaviour.side_changes <= most_side_changes(world)
