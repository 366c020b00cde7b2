"""Compare a navigator with the baselines in the same crowds."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

from plant.model.types import World
from study.people.baselines import omniscient_s, places_along, stand
from study.people.encounters import Encounters
from study.people.rates import HOUR_S, Rate
from study.statistics.intervals import Share
from study.trial.trial import Trial, run_trial

LIMIT_S = 300.0
COLUMNS = (
    *("family", "navigator", "trials", "arrived untouched", "touched", "touched, own"),
    *("standing, touched", "omniscient, touched", "own contacts per person-hour"),
    *("intruded s per person-hour", "time to collision < 2 s", "least, median"),
)


@dataclass(slots=True)
class Comparison:
    """Sums over the trials of one navigator in one family.

    `standing` is the sum over the worlds of the share of places along the shortest path where a
    robot is touched that stands there for as long as the trial took. `blocked` counts the worlds
    in which the omniscient robot finds no way without a contact. All worlds have a static way.
    """

    family: str
    navigator: str
    trials: int = 0
    untouched: int = 0
    touched: int = 0
    own: int = 0
    standing: float = 0.0
    blocked: int = 0
    own_contacts: int = 0
    time_s: float = 0.0
    person_s: float = 0.0
    intruded_s: float = 0.0
    soon_s: float = 0.0
    least_s: list[float] = field(default_factory=list)

    @property
    def own_rate(self) -> Rate:
        """Own contacts per person-hour."""
        return Rate(self.own_contacts, self.person_s / HOUR_S)

    @property
    def standing_rate(self) -> float:
        """Share of the trials in which a standing robot is touched."""
        return self.standing / self.trials


def compare(worlds: Sequence[World], family: str, navigator: str, noise: str) -> Comparison:
    """Run a trial in each world, with the index as its seed, and both baselines."""
    found = Comparison(family, navigator)
    for seed, world in enumerate(worlds):
        add(found, world, noise, seed)
    return found


def add(found: Comparison, world: World, noise: str, seed: int) -> None:
    """Add one trial and the baselines of its world."""
    encounters = Encounters(world)
    job = Trial(world=world, navigator=found.navigator, noise=noise, seed=seed, timeout_s=LIMIT_S)
    outcome = run_trial(job, encounters)
    found.trials += 1
    found.untouched += outcome.reached and not outcome.contacts
    found.touched += outcome.contacts > 0
    found.own += outcome.own_contacts > 0
    found.own_contacts += outcome.own_contacts
    places = places_along(world)
    touched = sum(stand(world, place, outcome.time_s).contacts > 0 for place in places)
    found.standing += touched / len(places)
    found.blocked += omniscient_s(world, LIMIT_S) is None
    found.time_s += encounters.time_s
    found.person_s += encounters.person_s
    found.intruded_s += encounters.intruded_s
    found.soon_s += encounters.soon_s
    found.least_s.append(encounters.least_s)


def table(rows: Sequence[Comparison]) -> str:
    """Return the comparisons as a Markdown table, with their intervals."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    lines += ["| " + " | ".join(_cells(row)) + " |" for row in rows]
    return "\n".join(lines)


def _cells(row: Comparison) -> list[str]:
    low, high = row.own_rate.interval
    hours = row.person_s / HOUR_S
    return [
        *(row.family, row.navigator, str(row.trials)),
        *(_share(count, row.trials) for count in (row.untouched, row.touched, row.own)),
        f"{100.0 * row.standing_rate:.1f} %",
        _share(row.blocked, row.trials),
        f"{row.own_rate.per_hour:.2f} ({low:.2f} to {high:.2f})",
        f"{row.intruded_s / hours:.0f}",
        f"{100.0 * row.soon_s / row.time_s:.1f} %",
        f"{median(row.least_s):.1f} s",
    ]


def _share(count: int, of: int) -> str:
    share = Share(count, of)
    low, high = share.interval
    return f"{100.0 * share.rate:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})"
