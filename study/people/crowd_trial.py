"""Trials in one world with people, with the baselines in the same world."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from plant.corpus import generate
from plant.model.types import World
from study.people.baselines import (
    PLACES,
    Stay,
    omniscient_route,
    places_along,
    route_exposure,
    stand,
    stay,
)
from study.people.encounters import Contact, Encounters, Exposure
from study.runner.plan import seed_of
from study.runner.sources import digest_of
from study.trial.trial import Trial, run_trial

LIMIT_S: Final = 300.0


class Series(NamedTuple):
    """Worlds of one family and seed, and the trials in each of them.

    A navigator is NAME:SIDE. `repeats` is the number of trials of each navigator in each world,
    with different noise. With `is_exposed` the exposure of both baselines is measured, too; the
    standing robot then stays as long as the first trial of the last navigator took.
    """

    family: str
    noise: str
    seed: int
    worlds: int
    navigators: tuple[str, ...] = ("vgm_memory:left",)
    repeats: int = 1
    is_exposed: bool = False


@dataclass(frozen=True, slots=True)
class CrowdTrial:
    """Result of one trial.

    `arrived` means without a contact. `standing` is the share of places along the shortest path
    at which a standing robot is touched within the time of the trial.
    """

    arrived: bool
    touched: bool
    own_contacts: int
    standing: float
    exposure: Exposure
    contacts: tuple[Contact, ...]


@dataclass(frozen=True, slots=True)
class WorldResult:
    """Results in one world; `blocked`: the omniscient robot finds no way without a contact.

    `stays` has one entry for each place along the shortest path. `stays` and `route` are only
    measured if the series is exposed.
    """

    trials: Mapping[str, tuple[CrowdTrial, ...]]
    blocked: bool
    stays: tuple[Stay, ...]
    route: Exposure | None


def run_world(series: Series, index: int) -> WorldResult:
    """Run the trials and both baselines in one world of a series."""
    world = generate(series.family, index, series.seed)
    digest = digest_of(world)
    trials = {
        navigator: tuple(
            run_crowd_trial(world, navigator, series.noise, seed_of(digest, number))
            for number in range(series.repeats)
        )
        for navigator in series.navigators
    }
    route = omniscient_route(world, LIMIT_S)
    if not series.is_exposed:
        return WorldResult(trials, route is None, (), None)
    duration_s = trials[series.navigators[-1]][0].exposure.time_s
    stays = tuple(stay(world, place, duration_s) for place in places_along(world))
    exposure = None if route is None else route_exposure(world, route)
    return WorldResult(trials, route is None, stays, exposure)


def run_crowd_trial(world: World, navigator: str, noise: str, seed: int) -> CrowdTrial:
    """Run one trial and the standing robot beside it; the world must have a static way."""
    name, _, side = navigator.partition(":")
    encounters = Encounters(world)
    trial = Trial(world=world, navigator=name, side=side, noise=noise, seed=seed, timeout_s=LIMIT_S)
    outcome = run_trial(trial, encounters)
    stays = stand(world, places_along(world), outcome.time_s)
    return CrowdTrial(
        arrived=outcome.reached and not outcome.contacts,
        touched=outcome.contacts > 0,
        own_contacts=outcome.own_contacts,
        standing=sum(one.contacts > 0 for one in stays) / PLACES,
        exposure=encounters.exposure,
        contacts=tuple(encounters.contacts),
    )
