"""`python -m checks.same_bits.trials COUNT`: print digests of random trials of the corpus.

Each line has the number of a trial, its digest, its settings and how it ended. Other libraries than
numpy, pymunk, msgspec and fastcrc are not needed.

Without COUNT it prints values of functions of libraries. This is a control: it shows whether a
variant changes what the C library, numpy and BLAS return. Each line has the name of a function and
its values for random arguments in hexadecimal.
"""

import math
import random
import sys
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from plant.corpus import FAMILIES, GRID_FAMILIES, generate
from plant.model.configuration import LEVELS
from plant.model.draws import Draws
from protocol.navigators import NAVIGATORS
from study.trial.trial import SIDES, Trial, run_trial

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


VALUES: Final = 20_000
LARGEST: Final = 3.0
VECTOR: Final = 20
"""Length of the vectors whose products are taken."""
OF_MATH: Final = ("sin", "cos", "exp", "tanh", "atan")


def lines() -> list[str]:
    """Return the lines to be printed."""
    source = random.Random(1)
    points = [(2.0 * source.random() - 1.0) * LARGEST for _ in range(VALUES)]
    array = np.array(points)
    table = array.reshape(-1, VECTOR)
    return [
        *(line(f"math.{name}", [getattr(math, name)(x) for x in points]) for name in OF_MATH),
        line("numpy.sin", np.sin(array).tolist()),
        line("numpy.exp", np.exp(array).tolist()),
        line("matrix product", (table @ table.T).ravel()[:VALUES].tolist()),
    ]


def line(name: str, values: Sequence[float]) -> str:
    """Return a name and values as a line."""
    return "\t".join((name, *(value.hex() for value in values)))


def values_of(line: str) -> tuple[str, list[str]]:
    """Return name and values of a printed line."""
    name, *values = line.split("\t")
    return name, values


if __name__ == "__main__":
    found = map(TrialDigest.line, results(range(int(sys.argv[1])))) if sys.argv[1:] else lines()
    for text in found:
        print(text, flush=True)
