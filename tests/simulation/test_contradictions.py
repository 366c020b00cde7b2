"""The observer of contradictions: it believes what is so, and nothing else."""

from tests.support.each import each
from verification.simulation.contradictions.draw import draw_persons
from verification.simulation.contradictions.run import APP, NOTEBOOK, observe
from verification.simulation.events import Argument, Event, EventScenario


def scenario(*events: tuple[float, str, *tuple[Argument, ...]], seconds: int = 12) -> EventScenario:
    """Return a scenario of deeds, each given by its time in s, its verb, program and arguments."""
    given = [Event(round(s * 1e9), verb, tuple(rest), 0) for s, verb, *rest in events]
    return EventScenario(1, seconds * 1_000_000_000, tuple(given))


def test_truth_of_one_person_holds_no_contradiction() -> None:
    result = observe(
        scenario(
            (0.5, "start", NOTEBOOK),
            (0.5, "start", APP),
            (1.5, "goto", NOTEBOOK, 30.4, 30.0),
        )
    )
    assert result.violation is None
    said = result.coverage.reached
    assert said["GoalEnded"] == said["Recorded"] == 1
    assert said["LeaseView"] > 1


@each("seed", [3, 8])
def test_run_of_persons_is_the_same_again(seed: int) -> None:
    assert observe(draw_persons(seed)).digest == observe(draw_persons(seed)).digest
