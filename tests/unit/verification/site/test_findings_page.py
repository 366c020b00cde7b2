"""The page of the falsifier's findings is as the files in the tree are."""

from pathlib import Path

import pytest

from checks.site import findings as findings_page
from checks.site.findings import WORLDS
from study.falsify.findings import read_finding


def test_page_shows_the_findings_in_the_tree() -> None:
    page = findings_page.PAGE.read_text(encoding="utf-8")
    assert findings_page.with_tables(page, WORLDS) == page, (
        "run `python -m checks.site.findings --page`"
    )
    for file in WORLDS.rglob("*.toml"):
        assert f"findings/{file.parent.name}/{file.stem}.svg" in page
        assert file.with_suffix(".svg").exists()
        assert read_finding(file).sentence in page


def test_tables_are_written_between_their_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    marks = findings_page.BEGIN, findings_page.END
    page.write_text(f"text\n{marks[0]}old\n{marks[1]}more\n", encoding="utf-8")
    findings_page.write_page(page)
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"text\n{marks[0]}")
    assert text.endswith(f"{marks[1]}more\n")
    assert "old" not in text.split("more")[0].splitlines()
    with pytest.raises(ValueError, match="the page has no"):
        findings_page.with_tables("text", WORLDS)


def test_findings_of_the_first_search_are_marked_and_counted() -> None:
    findings = [
        read_finding(file) for name in ("open", "fixed") for file in WORLDS.glob(f"{name}/*.toml")
    ]
    marked = [one for one in findings if findings_page.found_by(one).startswith("*first*")]
    assert 0 < len(marked) < len(findings)
    assert f"found {len(marked)} of these classes" in findings_page.tables(WORLDS)
