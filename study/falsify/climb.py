"""One climb: random candidates, then steps from the best that come nearer to a violation.

A climb is determined by its number alone, so that any number of processes finds the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Final

from plant.corpus.generate import ADVERSARIAL_FAMILIES
from plant.model.draws import Draws
from study.falsify import space
from study.falsify.evaluate import Subject, evaluate
from study.falsify.properties import Evaluation
from study.falsify.space import Candidate

STARTS: Final = 8
"""Random candidates of a climb; the best of them is where the steps begin.

Searches of about 425 trials for property b, with a navigator that failed often, found a failure in
5 of 39 climbs with one random candidate, 14 of 44 with four, and 21 of 47 with twelve and no steps.
Eight were not measured: between four and twelve, steps remain for failures that became rare.
"""

STEPS: Final = 12
"""Most trials of a climb, the random candidates included."""

MAX_TRIES: Final = 60
"""Most candidates without a valid world."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchSettings:
    """Settings that determine a search: equal ones find the same."""

    subject: Subject
    properties: str
    families: Sequence[str] = ADVERSARIAL_FAMILIES
    varied: Sequence[str] = ()
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """A violated property, its class, and the candidate and trial that violate it."""

    letter: str
    candidate: Candidate
    evaluation: Evaluation

    @property
    def failure_class(self) -> str:
        """Property, family and kind of end: violations with the same are counted as one."""
        return class_of(self.letter, self.candidate.family, self.evaluation.kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class Climb:
    """The result of a climb."""

    number: int
    trials: int
    simulated_s: float
    violations: tuple[Violation, ...]


def class_of(letter: str, family: str, kind: str) -> str:
    """Return the name of a class of failure, which is also the name of its files."""
    return f"{letter}-{family}-{kind}"


def climb(settings: SearchSettings, number: int) -> Climb:
    """Run a climb until its first violation of the property that it aims at, or its last step."""
    families, letters = settings.families, settings.properties
    family = families[number % len(families)]
    aim = letters[number // len(families) % len(letters)]
    random = Draws(f"falsify/{settings.seed}/{number}")
    best: Candidate | None = None
    best_score, trials, simulated_s = -inf, 0, 0.0
    found: dict[str, Violation] = {}
    for _ in range(MAX_TRIES):
        one = step(random, family, best if trials >= STARTS else None, settings.varied)
        world = space.built(one, f"{family}_{settings.seed}_{number}", settings.seed)
        if world is None:
            continue
        result = evaluate(settings.subject, world, round(one.values["seed"]))
        trials, simulated_s = trials + 1, simulated_s + result.outcome.time_s
        for letter in sorted(set(result.violated) & set(letters)):
            violation = Violation(letter=letter, candidate=one, evaluation=result)
            found.setdefault(violation.failure_class, violation)
        if aim in result.violated or trials == STEPS:
            break
        if best is None or result.scores[aim] >= best_score:
            best, best_score = one, result.scores[aim]
    return Climb(
        number=number, trials=trials, simulated_s=simulated_s, violations=tuple(found.values())
    )


def step(random: Draws, family: str, best: Candidate | None, varied: Sequence[str]) -> Candidate:
    """Return the next candidate: a random one without a best, else a neighbour of it."""
    if best is None:
        return space.draw(random, family, varied)
    return space.neighbour(random, best, varied)
