"""Cost of the app beside a real robot. CPU and bytes are asserted with a margin, times are not."""

import argparse

import pytest

from checks.harness.figures import Figure
from checks.speed.ground_station import app_figures as ground

pytestmark = pytest.mark.stack


def figures(*words: str) -> dict[str, Figure]:
    parser = argparse.ArgumentParser()
    ground.add_options(parser)
    report = ground.measure(parser.parse_args(words))
    assert report.text()
    return {figure.name: figure for figure in report.figures}


@pytest.mark.realtime
def test_a_driving_robot_costs_little_a_paused_one_less_and_a_slow_line_is_not_flooded() -> None:
    short = ("--seconds", "1", "--settle", "0.3", "--slow-presses", "2", "--repetitions", "1")
    found = figures("--parts", "cost", *short)
    for size, cpu, kb in (("80x24", 20.0, 90.0), ("140x40", 32.0, 180.0)):
        assert found[f"CPU of one core, driving, {size}"].median < cpu
        assert 1.0 < found[f"written, driving, {size}"].median < kb
    paused, driving = (found[f"written, {what}, 80x24"].median for what in ("paused", "driving"))
    assert paused < 0.5 * driving  # what its cycles cost goes on changing
    assert found["written, nothing changes, 80x24"].median == 0.0
    assert found["written, slow line, 140x40"].median < 20.5


@pytest.mark.realtime
def test_a_key_holds_the_robot_and_another_one_stops_it() -> None:
    found = figures("--parts", "keys", "--presses", "2")
    assert len(found["hold: key to robot acts"].values) == 2
    assert found["e-stop: rolled"].median < found["hold: rolled"].median + 0.05


def test_the_screen_is_painted_and_reacts_in_a_flood_of_lines() -> None:
    words = ("--starts", "1", "--minutes", "0.05", "--lines", "2000", "--presses-after", "4")
    found = figures("--parts", "paint", "crowd", *words)
    assert found["first bytes"].median <= found["first paint"].median
    assert len(found["key to screen, after it"].values) >= 4
