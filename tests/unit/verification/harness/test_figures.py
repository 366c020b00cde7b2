"""Figures and reports: verdicts, formats and percentiles."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.figures import BenchmarkReport, Figure, digits, percentile, ratios
from tests.support.each import each

finite = st.floats(-1e9, 1e9)


def figure(*values: float, least: float | None = None, most: float | None = None) -> Figure:
    return Figure(name="speed", unit="x", values=values, at_least=least, at_most=most)


def test_single_good_repetition_does_not_meet_threshold() -> None:
    assert figure(390.0, 395.0, 900.0, least=400.0).met is False
    assert figure(390.0, 405.0, 410.0, least=400.0).met is True


def test_upper_limit_is_met_at_its_value() -> None:
    assert figure(2.0, most=2.0).met is True
    assert figure(2.1, most=2.0).met is False


def test_figure_without_threshold_has_no_verdict() -> None:
    assert figure(1.0).met is None
    assert "met" not in figure(1.0).line()
    assert "MISSED" not in figure(1.0).line()


def test_missed_figure_shows_spread_and_threshold() -> None:
    line = figure(1.0, 2.0, 3.0, least=5.0).line()
    assert "MISSED" in line
    assert "(1 to 3, 3 times)" in line
    assert ">= 5" in line


def test_missing_values_are_an_error() -> None:
    with pytest.raises(ValueError, match="nothing was measured"):
        figure()
    with pytest.raises(ValueError, match="no values"):
        percentile([], 0.5)


def test_report_is_met_if_every_figure_is() -> None:
    good, bad, free = figure(1.0, most=2.0), figure(3.0, most=2.0), figure(9.0)
    assert BenchmarkReport(benchmark="b", figures=(good, free)).met
    assert not BenchmarkReport(benchmark="b", figures=(good, bad)).met


def test_report_is_written_as_json() -> None:
    report = BenchmarkReport(
        benchmark="b", figures=(figure(1.0),), notes=("n",), machine={"cores": 2}
    )
    read = json.loads(json.dumps(report.as_json()))
    assert read["figures"][0]["median"] == 1.0
    assert read["met"] is True
    assert "cores 2" in report.text()
    assert "note: n" in report.text()


def test_report_of_parts_keeps_their_order() -> None:
    first, second = (Figure(name=name, unit="ms", values=(1.0,)) for name in ("first", "second"))
    report = BenchmarkReport.of("two", [([first], ["note"]), ([second], [])])
    assert report == BenchmarkReport(benchmark="two", figures=(first, second), notes=("note",))


def test_percentiles_are_measured_values() -> None:
    values = [float(v) for v in range(1, 101)]
    assert percentile(values, 0.5) == 50.0
    assert percentile(values, 0.99) == 99.0
    assert percentile(values, 1.0) == 100.0
    assert percentile([7.0], 0.0) == 7.0


@given(st.lists(finite, min_size=1), st.floats(0.0, 1.0))
def test_percentile_is_not_exceeded_by_its_share(values: list[float], share: float) -> None:
    limit = percentile(values, share)
    assert limit in values
    assert sum(value <= limit for value in values) >= share * len(values) - 1e-6


def test_ratios_divide_pair_by_pair() -> None:
    assert ratios([4.0, 9.0], [2.0, 3.0]) == (2.0, 3.0)
    with pytest.raises(ValueError, match="longer"):
        ratios([1.0], [1.0, 2.0])


@each(
    ("value", "text"), [(0.0, "0"), (0.012345, "0.01235"), (123.456, "123.5"), (12345.6, "12346")]
)
def test_figures_have_four_digits(value: float, text: str) -> None:
    assert digits(value) == text
