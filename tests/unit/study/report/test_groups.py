"""The corpus is judged alone; grid maps, thin walls, crowds and adversarial worlds are apart."""

from plant.corpus import ADVERSARIAL_FAMILIES, CROWD_FAMILIES, FAMILIES, GRID_FAMILIES
from study.cli.report import summary_of
from study.report.build import ReportRequest, page_of
from study.report.page import markdown_of
from study.report.trials import (
    ADVERSARIAL,
    CORPUS,
    CROWDS,
    GRIDS,
    THIN,
    apart_of,
    group_of,
    main_of,
)
from study.runner.store import table_of
from tests.support.each import each
from tests.support.study.report.made import GAVE_UP, row, trials


@each(
    ("family", "group"),
    [
        *((family, CORPUS) for family in ("box", "moving", "unreachable", "other")),
        *((family, GRIDS) for family in (*GRID_FAMILIES, "moving_ai_room")),
        *((family, ADVERSARIAL) for family in ADVERSARIAL_FAMILIES),
        *((family, CROWDS) for family in CROWD_FAMILIES),
        ("thin", THIN),
    ],
)
def test_each_family_has_one_group(family: str, group: str) -> None:
    assert group_of(family) == group


def test_no_family_of_the_corpus_is_adversarial() -> None:
    assert not set(FAMILIES) & set(ADVERSARIAL_FAMILIES)


def test_study_without_the_corpus_is_not_split() -> None:
    grids = trials(row(family="grid_maze"))
    assert len(main_of(grids)) == 1
    assert apart_of(grids) == {}


def test_groups_apart_do_not_change_the_figures_of_the_corpus() -> None:
    others = [row(family="comb", **GAVE_UP), row(family="grid_maze", **GAVE_UP)]
    alone, mixed = (
        summary_of(table_of(rows), ReportRequest()) for rows in ([row()], [row(), *others])
    )
    assert mixed["rows"] == alone["rows"]
    assert (mixed["trials"], mixed["families"]) == (1, 1)
    assert list(mixed["rows_apart"]) == [GRIDS, ADVERSARIAL]


def test_page_marks_adversarial_worlds() -> None:
    page = page_of(table_of([row(), row(family="comb")]), ReportRequest(failures=0))
    text = markdown_of(page, "f")
    before, _, after = text.partition("## Worlds apart from the corpus")
    assert "comb" not in before.partition("Verdict")[2]
    assert "### Adversarial worlds\n\n**Adversarial**" in after
    plain = markdown_of(page_of(table_of([row()]), ReportRequest(failures=0)), "f")
    assert "Worlds apart" not in plain
