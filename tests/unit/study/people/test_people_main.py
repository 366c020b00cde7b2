"""The command that writes the page, and prints tables of other worlds."""

import json
from multiprocessing.pool import ThreadPool
from pathlib import Path

import pytest

from study.people import __main__ as command
from study.people.__main__ import BEGIN, CONTACTS, END, NAVIGATORS
from study.people.crowd_trial import TrialSeries
from tests.support.docs.session import ROOT

MARKS = ("contacts", "crowd", "crowd_hasty", "origins")


def table_in(page: str, name: str) -> list[str]:
    text = page.partition(BEGIN.format(name))[2].partition(END.format(name))[0]
    return [line for line in text.splitlines() if line.startswith("|")]


def test_command_fills_every_table_of_the_committed_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts = [series._replace(worlds=1, repeats=1) for series in CONTACTS]
    navigators = [series._replace(worlds=1, navigators=("bug2:left",)) for series in NAVIGATORS]
    monkeypatch.setattr(command, "CONTACTS", contacts)
    monkeypatch.setattr(command, "NAVIGATORS", navigators)
    page, counts = tmp_path / "people.md", tmp_path / "people.json"
    page.write_text((ROOT / command.PAGE).read_text(encoding="utf-8"), encoding="utf-8")
    with ThreadPool(1) as workers:
        command.write_page(workers, page, counts)
    text = page.read_text(encoding="utf-8")
    assert all(len(table_in(text, name)) > 3 for name in MARKS)
    assert table_in(text, "contacts")[0].count("crowd") == 8
    assert "| worlds | 1 | 1 | 2 | 1 | 1 | 1 | 2 | 1 | 1 |" in table_in(text, "contacts")
    found = json.loads(counts.read_text(encoding="utf-8"))
    assert [one["noise"] for one in found["crowds"]] == [one.noise for one in CONTACTS]
    assert [one["navigator"] for one in found["navigators"]] == ["bug2", "bug2"]


def test_other_worlds_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--family", "crowd", "--worlds", "1", "--noise", "none", "--processes", "1"]
    assert command.main(arguments) == 0
    printed = capsys.readouterr().out
    assert "| navigator | vgm_memory |" in printed
    assert "\n| omniscient robot |" in printed


def test_unknown_navigator_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--family", "crowd", "--navigator", "bug3", "--processes", "1"]
    assert command.main(arguments) == 2
    assert "bug3" in capsys.readouterr().err


def test_series_of_one_world_runs_once_for_each_navigator() -> None:
    series = TrialSeries("crowd", "none", 7, 1, ("bug2:left", "vgm_memory:left"), is_exposed=True)
    with ThreadPool(1) as workers:
        first, second = command.run(workers, series)
    assert (first.navigator, second.navigator) == series.navigators
    assert len(first.trials) == len(second.trials) == 1
