"""The verdict names the best navigator, the paper's comparison, contacts and missed figures."""

from dataclasses import replace

from study.cli.report import lines_of
from study.report.build import in_words, reached, verdict
from study.report.comparisons import comparisons
from study.report.page import Paragraph
from study.report.summary import as_json, summaries
from study.report.targets import targets
from study.report.trials import Trials, trials_of
from tests.support.study.report.made import study


def sentences(trials: Trials) -> list[str]:
    section = verdict(trials, summaries(trials), targets(trials))
    return [block.words for block in section.blocks if isinstance(block, Paragraph)]


def test_the_best_navigator_is_named_with_its_share_at_the_usual_noise() -> None:
    trials = trials_of(study())
    first = sentences(trials)[0]
    found = [one for one in summaries(trials) if one.noise == "default"]
    best = max(found, key=lambda one: one.success.rate)
    assert first.startswith(f"**{best.label} arrives most often**: ")
    assert "`default` noise" in first
    assert f" of {best.success.of} trials" in first.replace("%", "").replace("  ", " ")


def test_bound_is_neither_the_best_navigator_nor_in_the_readme() -> None:
    trials = trials_of(study(("bug", "oracle_grid")))
    assert sentences(trials)[0].startswith("**bug arrives most often**")
    assert "oracle_grid" not in lines_of(as_json(summaries(trials)))


def test_noise_that_was_not_run_is_not_judged() -> None:
    assert "`harsh` noise" in sentences(trials_of(study(noises=("harsh",))))[0]


def test_the_papers_navigators_differ_only_if_the_test_says_so() -> None:
    one = comparisons(trials_of(study()), "default")[0]
    equal = replace(one, first="bug", second="vgm", only_first=3, only_second=2, p_success=0.8)
    assert in_words(equal) == (
        "The study shows **no clear difference** between bug and vgm: in"
        f" {equal.pairs} pairs of trials only bug succeeds in 3, only vgm in 2 (p = 0.80)."
    )
    better = replace(equal, only_second=40, p_success=0.00001)
    assert in_words(better).startswith("**vgm succeeds more often than bug**: ")
    assert in_words(better).endswith("(p < 0.0001).")


def test_missed_figures_are_named_and_unmeasured_ones_are_not_judged() -> None:
    wanted = targets(trials_of(study()))
    some = [replace(one, verdict="met") for one in wanted[:3]]
    missed = replace(wanted[0], what="of these, x", noise="harsh", verdict="missed")
    unmeasured = replace(wanted[0], verdict="not measured")
    assert reached([*some, missed, unmeasured]) == [
        "3 of 4 figures to reach are met. Missed: x (harsh)."
    ]
    assert reached([unmeasured]) == []
