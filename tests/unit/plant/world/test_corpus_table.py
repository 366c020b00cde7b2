"""The [corpus] table of a world file."""

from plant.shortest_path import known_length_m, shortest_path_m
from plant.world.file import loads
from study.trial.trial import Trial, run_trial, shortest_once
from tests.support.each import each
from tests.support.plant.world_texts import GOOD, Bad, assert_told, more, refusal

WHOLE = """
[corpus]
family = "u_trap"
seed = 7
shortest_path_m = 5.25
reachable = true
"""


def test_world_contains_the_values_of_its_corpus_table() -> None:
    world = loads(more(WHOLE))
    known = (world.family, world.family_seed, world.shortest_path_m, world.reachable)
    assert known == ("u_trap", 7, 5.25, True)


def test_file_without_corpus_table_has_no_values() -> None:
    world = loads(GOOD)
    known = (world.family, world.family_seed, world.shortest_path_m, world.reachable)
    assert known == (None, None, None, None)
    assert known_length_m(world) == shortest_path_m(world)


def test_shortest_path_implies_a_reachable_goal() -> None:
    assert loads(more("[corpus]\nshortest_path_m = 5.25\n")).reachable is True


def test_shortest_path_of_the_file_is_not_recomputed() -> None:
    assert known_length_m(loads(more(WHOLE))) == 5.25
    assert known_length_m(loads(more("[corpus]\nreachable = false\n"))) is None
    assert shortest_once(loads(more(WHOLE))) == 5.25


def test_trial_reports_the_path_length_of_the_file() -> None:
    outcome = run_trial(Trial(world=loads(more(WHOLE)), timeout_s=0.1))
    assert outcome.shortest_path_m == 5.25


BAD = [
    Bad("seed below zero", "seed = -1", 21, "corpus.seed", "out of range", "0 to"),
    Bad("seed with a fraction", "seed = 1.5", 21, "corpus.seed", "a whole number", "seed = 1"),
    Bad("seed as text", 'seed = "1"', 21, "corpus.seed", "found text", "seed = 1"),
    Bad("family as number", "family = 3", 21, "corpus.family", "expected text", "u_trap"),
    Bad("empty family", 'family = " "', 21, "corpus.family", "empty", "u_trap"),
    Bad("long family", f'family = "{"f" * 65}"', 21, "corpus.family", "longer", "u_trap"),
    Bad("path not finite", "shortest_path_m = nan", 21, "corpus.shortest_path_m", "not finite", ""),
    Bad("negative path", "shortest_path_m = -1", 21, "corpus.shortest_path_m", "out of range", ""),
    Bad(
        "path shorter than straight",
        "shortest_path_m = 4.7",
        21,
        "corpus.shortest_path_m",
        "shorter than the straight line of 4.800 m",
        "remove it",
    ),
    Bad("reachable as text", 'reachable = "no"', 21, "corpus.reachable", "true or false", "true"),
    Bad("misspelt", "familiy = 'x'", 21, "corpus.familiy", "unknown key", "did you mean family"),
    Bad("other unit", "shortest_path_cm = 500", 21, "corpus.shortest_path_cm", "wrong unit", "= 5"),
]


@each("bad", BAD)
def test_invalid_corpus_table_is_rejected(bad: Bad) -> None:
    assert_told(bad._replace(text=more(f"[corpus]\n{bad.text}\n")), alone=True)


def test_path_to_an_unreachable_goal_is_rejected() -> None:
    text = more("[corpus]\nshortest_path_m = 5.0\nreachable = false\n")
    (problem,) = refusal(text).problems
    assert (problem.line, problem.key) == (21, "corpus.shortest_path_m")
    assert "unreachable goal" in problem.reason


def test_corpus_value_that_is_no_table_is_rejected() -> None:
    (problem,) = refusal("corpus = 3\n" + GOOD).problems
    assert (problem.line, problem.key) == (1, "corpus")
    assert "expected a table, found a whole number" in problem.reason
