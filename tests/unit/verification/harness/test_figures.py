"""How a measurement is judged and shown; no benchmark is run here."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from verification.harness.figures import Figure, Report, digits, percentile, ratios

finite = st.floats(-1e9, 1e9)


def figure(*values: float, least: float | None = None, most: float | None = None) -> Figure:
    return Figure(name="speed", unit="x", values=values, at_least=least, at_most=most)


def test_one_lucky_repetition_does_not_meet_a_threshold() -> None:
    assert figure(390.0, 395.0, 900.0, least=400.0).met is False
    assert figure(390.0, 405.0, 410.0, least=400.0).met is True


def test_an_upper_limit_is_missed_above_it_and_met_at_it() -> None:
    assert figure(2.0, most=2.0).met is True
    assert figure(2.1, most=2.0).met is False


def test_without_a_threshold_nothing_is_claimed() -> None:
    assert figure(1.0).met is None
    assert "met" not in figure(1.0).line()
    assert "MISSED" not in figure(1.0).line()


def test_a_miss_is_shown_as_a_miss_with_its_spread() -> None:
    line = figure(1.0, 2.0, 3.0, least=5.0).line()
    assert "MISSED" in line
    assert "(1 to 3, 3 times)" in line
    assert ">= 5" in line


def test_nothing_measured_is_an_error_and_not_a_zero() -> None:
    with pytest.raises(ValueError, match="nothing was measured"):
        figure()
    with pytest.raises(ValueError, match="no values"):
        percentile([], 0.5)


def test_a_report_is_met_only_when_every_figure_is() -> None:
    good, bad, free = figure(1.0, most=2.0), figure(3.0, most=2.0), figure(9.0)
    assert Report(benchmark="b", figures=(good, free)).met
    assert not Report(benchmark="b", figures=(good, bad)).met


def test_a_report_survives_json() -> None:
    report = Report(benchmark="b", figures=(figure(1.0),), notes=("n",), machine={"cores": 2})
    said = json.loads(json.dumps(report.as_json()))
    assert said["figures"][0]["median"] == 1.0
    assert said["met"] is True
    assert "cores 2" in report.text()
    assert "note: n" in report.text()


def test_percentiles_are_values_that_were_measured() -> None:
    values = [float(v) for v in range(1, 101)]
    assert percentile(values, 0.5) == 50.0
    assert percentile(values, 0.99) == 99.0
    assert percentile(values, 1.0) == 100.0
    assert percentile([7.0], 0.0) == 7.0


@given(st.lists(finite, min_size=1), st.floats(0.0, 1.0))
def test_a_percentile_is_never_exceeded_by_more_than_the_rest(
    values: list[float], share: float
) -> None:
    limit = percentile(values, share)
    assert limit in values
    assert sum(value <= limit for value in values) >= share * len(values) - 1e-6


def test_ratios_are_taken_pair_by_pair() -> None:
    assert ratios([4.0, 9.0], [2.0, 3.0]) == (2.0, 3.0)
    with pytest.raises(ValueError, match="longer"):
        ratios([1.0], [1.0, 2.0])


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (0.012345, "0.01235"), (123.456, "123.5"), (12345.6, "12346")]
)
def test_figures_are_shown_with_four_digits(value: float, text: str) -> None:
    assert digits(value) == text
