"""`python -m checks.same_bits.trials COUNT`: print digests of random trials of the corpus.

Each line has the number of a trial, its digest, its settings and how it ended. Other
libraries than numpy, pymunk, msgspec and fastcrc are not needed.
"""

import sys
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from plant.corpus import FAMILIES, GRID_FAMILIES, generate
from plant.model.configuration import LEVELS
from plant.model.draws import Draws
from study.trial.trial import NAVIGATORS, SIDES, Trial, run_trial

TIMEOUT_S: Final = 20.0
LAST_START_S: Final = 60
WORLDS: Final = 10**6


class TrialDigest(NamedTuple):
    """A trial by number, the digest of its trajectory, its settings and its outcome."""

    number: int
    digest: str
    settings: str
    outcome: str

    def line(self) -> str:
        """Return the result as it is printed."""
        return "\t".join((str(self.number), *self[1:]))


def result_of(line: str) -> TrialDigest:
    """Return the result in a printed line; raise ValueError for a malformed line."""
    number, digest, settings, outcome = line.split("\t")
    return TrialDigest(int(number), digest, settings, outcome)


def trial_of(number: int) -> Trial:
    """Return a trial by its number: any family, navigator, side, noise, seed and time of start."""
    draws = Draws(f"same bits {number}")
    family = draws.choice((*FAMILIES, *GRID_FAMILIES))
    return Trial(
        world=generate(family, draws.randrange(WORLDS), draws.randrange(WORLDS)),
        navigator=draws.choice(tuple(NAVIGATORS)),
        side=draws.choice(tuple(SIDES)),
        seed=draws.randrange(WORLDS),
        noise=draws.choice(tuple(LEVELS)),
        timeout_s=TIMEOUT_S,
        at_s=float(draws.randrange(LAST_START_S)),
    )


def results(numbers: Sequence[int]) -> Iterator[TrialDigest]:
    """Run trials and yield their results."""
    for number in numbers:
        trial = trial_of(number)
        ended = run_trial(trial)
        settings = f"{trial.world.name} {trial.navigator} {trial.side} {trial.noise} {trial.seed}"
        yield TrialDigest(number, ended.digest, settings, ended.outcome)


if __name__ == "__main__":
    for one in results(range(int(sys.argv[1]))):
        print(one.line(), flush=True)
