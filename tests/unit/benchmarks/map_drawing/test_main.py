"""The benchmark of the map draws the intended scenes; its speed is not checked here."""

from argparse import ArgumentParser
from functools import partial

import pytest
from rich.text import Text

from checks.speed import map_drawing as benchmark
from checks.speed.map_drawing import (
    PlotextMap,
    driving_trails,
    measure_frames,
    moving_trails,
    recorded_canvas,
    segments,
)
from ground.app.widgets.map import MapWidget


def test_every_frame_has_500_segments_and_14_obstacles() -> None:
    for scene in (*moving_trails(3), *driving_trails(3)):
        assert segments(recorded_canvas(scene, *benchmark.SIZE)) >= 500
        assert len(scene.obstacles) == 14 + 1  # the wall around them


def test_scenes_differ_in_the_rows_that_change() -> None:
    for scenes, least, most in ((moving_trails(2), 30, 40), (driving_trails(2), 1, 15)):
        one, other = (recorded_canvas(scene, *benchmark.SIZE) for scene in scenes)
        assert least <= len(one.changed_rows(other)) <= most


def test_frame_cost_counts_its_output() -> None:
    widget = MapWidget()
    scenes = moving_trails(7)
    cost = measure_frames(widget, [partial(widget.show, scene) for scene in scenes], (40, 12))
    assert len(cost.cpu_ms) == len(cost.written_kb) == 2
    assert all(0.3 < kb < 5.0 for kb in cost.written_kb)
    assert all(ms > 0.0 for ms in cost.cpu_ms)


def test_plotext_draws_the_same_lines() -> None:
    canvas = recorded_canvas(moving_trails(1)[0], 40, 12)
    widget = PlotextMap()
    lines = benchmark.lines_of(canvas)
    measure_frames(widget, [partial(widget.show, lines)] * 3, (40, 12))
    text = Text.from_ansi(widget.plt.build()).plain
    theirs = sum(character not in " \n" for character in text)
    ours = sum(character != " " for character in "".join(canvas.to_rows()))
    assert 0.7 * ours < theirs < 1.3 * ours


def test_report_has_both_and_their_ratio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "SIZE", (50, 20))
    parser = ArgumentParser()
    benchmark.add_options(parser)
    options = parser.parse_args(["--repetitions", "1", "--frames", "7"])
    report = benchmark.measure(options)
    named = {figure.name: figure for figure in report.figures}
    assert named["frame, all moves"].at_most == 4.0
    assert named["ours / textual-plotext"].at_most == 0.2
    assert named["written, driving"].median < named["written, all moves"].median
