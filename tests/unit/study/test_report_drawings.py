"""Drawings of the report: coordinates, maps, and the gallery of failures."""

from math import hypot, inf, nan, pi, sqrt
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.model.errors import WorldError, WorldProblem
from plant.world.file import load
from protocol.outcome import CHI2_2
from protocol.world import World
from runtime.errors import UserError
from study.intervals import Proportion
from study.report.charts import SvgDrawing, bars, distribution_chart, n, steps, success_chart
from study.report.drives import drive_all, drive_trial
from study.report.gallery import command_of, diverse, gallery, kind_of, selected_failures
from study.report.page import Gallery, Paragraph
from study.report.trials import distinct, trials_of
from study.report.world_map import WorldMap, ellipse, end_mark, simplified
from study.runner.rows import TrialRow
from study.runner.run_task import trial_of
from study.runner.store import table_of
from study.trial.trial import Trial, run_trial
from tests.support.each import each
from tests.support.studies import COLLIDED, GAVE_UP, SHUT, STUCK, boxed, drive, floor, row, study


def shapes(drawing: SvgDrawing) -> list[str]:
    """Return the shapes of a drawing, which must be well-formed alone and in a page."""
    assert ElementTree.fromstring(drawing.inline()).tag == "svg"
    root = ElementTree.fromstring(drawing.alone())
    return [child.tag.partition("}")[2] for child in root]


@given(st.floats(-1e7, 1e7))
def test_coordinates_are_short_and_never_minus_zero(value: float) -> None:
    assert float(n(value)) == pytest.approx(value, abs=0.051 if abs(value) < 1e5 else 0.51)
    assert n(value) != "-0"
    assert "e" not in n(value)


def test_text_is_escaped() -> None:
    drawing = SvgDrawing(10, 10, "a < b & c")
    drawing.text((1, 1), "<&>")
    assert shapes(drawing)[-1] == "text"
    assert ElementTree.fromstring(drawing.inline())[0].text == "a < b & c"


def test_rerun_gives_the_same_drive() -> None:
    trial = Trial(world=boxed(), seed=3, noise="default")
    found = drive_trial(trial)
    assert found.outcome.digest == run_trial(trial).digest
    assert len(found.true) == len(found.believed) == len(found.branches) == found.outcome.ticks + 1
    assert found.covariance[0] > 0.0


def test_drives_keep_their_order_on_several_processes() -> None:
    trials = [Trial(world=floor(), seed=seed, noise="default") for seed in range(3)]
    alone, together = drive_all(trials, 1), drive_all(trials, 2)
    assert [one.outcome.digest for one in alone] == [one.outcome.digest for one in together]
    assert [one.trial.seed for one in together] == [0, 1, 2]


@given(st.lists(st.tuples(st.floats(0, 5), st.floats(0, 5), st.just(0.0)), min_size=1, max_size=60))
def test_simplified_path_stays_within_its_tolerance(
    poses: list[tuple[float, float, float]],
) -> None:
    kept = simplified(poses)
    assert kept[0] == poses[0][:2]
    assert kept[-1] == poses[-1][:2]
    for x, y, _ in poses:
        segments = list(zip(kept, kept[1:] or kept, strict=False))
        assert min(distance((x, y), a, b) for a, b in segments) <= 0.0041


def distance(p: tuple[float, float], a: tuple[float, float], b: tuple[float, float]) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    length2 = dx * dx + dy * dy
    share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / length2 if length2 > 0 else 0.0
    share = min(1.0, max(0.0, share))
    return hypot(p[0] - a[0] - share * dx, p[1] - a[1] - share * dy)


def test_straight_path_has_two_points() -> None:
    assert len(simplified([(x / 100, 1.0, 0.0) for x in range(300)])) == 2


def test_ellipse_has_the_axes_of_the_covariance() -> None:
    long_m, short_m, turn_rad = ellipse((0.01, 0.0, 0.04))
    assert long_m == pytest.approx(0.2 * sqrt(CHI2_2))
    assert short_m == pytest.approx(0.1 * sqrt(CHI2_2))
    assert abs(turn_rad) == pytest.approx(pi / 2)
    assert ellipse((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)


@each("name", ["moving", "zigzag", "u_trap", "forest_dense", "open"])
def test_every_kind_of_world_can_be_drawn(name: str) -> None:
    world = load(name)
    plan = WorldMap(world, 300.0, f"the world {name}")
    path = [(world.start.x_m, world.start.y_m, 0.0), (world.goal.x_m, world.goal.y_m, 0.0)]
    plan.straight()
    plan.add(drive(path, world=world), belief=True)
    plan.ends()
    assert {"rect", "polyline", "ellipse", "circle", "line", "text"} <= set(shapes(plan.drawing))


def test_outcomes_have_different_end_marks() -> None:
    ends, marks = {}, set()
    for outcome in ("reached", "collided", "stuck", "unreachable", "lost", "timeout"):
        drawing = SvgDrawing(20, 20, "an end")
        end_mark(drawing, (10, 10), outcome, "mark")
        ends[outcome] = shapes(drawing)[-1]
        marks.add(drawing.alone())
    assert ends["reached"] == "circle"
    assert ends["stuck"] == ends["unreachable"] == "rect"
    assert ends["timeout"] == ends["lost"] == "polygon"
    assert len(marks) == len(ends)


def test_charts_without_data_are_valid() -> None:
    assert shapes(success_chart({}, [], "none"))
    assert shapes(success_chart({"none": {"vgm": Proportion(0, 0)}}, ["vgm"], "none"))
    assert shapes(bars({}, {}, "none"))
    assert shapes(distribution_chart({}, "none", "m", (0.1, 10.0)))
    empty = {"none": {"vgm": np.array([nan, inf])}}
    assert "polyline" not in shapes(distribution_chart(empty, "none", "m", (0.1, 10.0)))


def test_distribution_rises_from_0_to_1() -> None:
    found = steps(np.random.default_rng(1).exponential(size=5000))
    assert found[0][1] == 0.0
    assert found[-1][1] == 1.0
    assert found == sorted(found)
    assert len(found) <= 80


def a_world(source: str) -> World:
    return floor()


def picked(*rows: TrialRow, most: int = 6) -> list[str]:
    table = table_of(list(rows))
    return [one.row.world for one in selected_failures(table, distinct(trials_of(table)), most)]


def test_selects_only_failures_up_to_the_limit() -> None:
    assert picked(row(), row(world="b", **STUCK), row(world="c", family="maze", **STUCK)) == [
        *("b", "c"),
    ]
    assert picked(row(world="b", **STUCK), row(world="c", family="f", **STUCK), most=1) == ["b"]
    assert picked(row(**{**SHUT, **GAVE_UP}), row()) == []


def test_selects_each_kind_and_family_in_turn() -> None:
    rows = [row(seed=seed, family="maze", **STUCK) for seed in range(50)]
    rows += [row(family="box", **STUCK), row(family="disc", **COLLIDED), row(**GAVE_UP)]
    rows += [row(family="disc", outcome="timeout")]
    found = diverse(rows, 5)
    assert {kind_of(one) for one in found} == {
        *("stuck", "collided", "called unreachable", "timeout"),
    }
    assert {one.family for one in found} == {"maze", "box", "disc"}
    assert found == diverse(rows[::-1], 5)


def test_kind_of_a_failure_depends_on_its_outcome() -> None:
    assert kind_of(row(contacts=1)) == "hit by an obstacle"
    assert kind_of(row(**{**SHUT, **STUCK})) == "stuck"
    assert kind_of(row(**SHUT)) == "reached"


def test_failed_trials_are_not_drawn() -> None:
    assert picked(row(outcome="failed", digest="")) == []


def test_failure_is_drawn_with_its_id_and_command() -> None:
    table = study(("bug", "vgm"))
    section = gallery(selected_failures(table, distinct(trials_of(table)), 2), a_world, 1)
    assert [part.title for part in section.parts] == ["bug", "vgm"]
    (some,) = section.parts[0].blocks
    assert isinstance(some, Gallery)
    assert len(some.figures) == 2
    for figure in some.figures:
        assert "trial `" in figure.note
        assert "This is not the recorded drive" in figure.note
        assert figure.code.startswith("sidestep worlds generate --family ")


def test_reproduced_drive_has_no_warning() -> None:
    failing = row(outcome="stuck", timeout_s=1.0, world="floor", noise="none")
    digest = run_trial(trial_of(failing, floor())).digest
    table = table_of([row(outcome="stuck", timeout_s=1.0, noise="none", digest=digest)])
    section = gallery(selected_failures(table, trials_of(table), 1), a_world, 1)
    (some,) = section.parts[0].blocks
    assert isinstance(some, Gallery)
    assert "recorded" not in some.figures[0].note


@each(
    "error",
    [
        UserError("world_source: unknown"),
        WorldError([WorldProblem("gone.toml", None, "", "not there", "look")]),
        ValueError("no family"),
    ],
)
def test_missing_world_is_reported_and_others_drawn(error: Exception) -> None:
    def some_worlds(source: str) -> World:
        if "u_trap" in source:
            raise error
        return floor()

    table = study(("vgm",))
    section = gallery(selected_failures(table, distinct(trials_of(table)), 6), some_worlds, 1)
    lost = section.blocks[1]
    assert isinstance(lost, Paragraph)
    assert lost.words.startswith("Could not be run again: `")
    assert len(section.parts) == 1


def test_gallery_without_failures_has_a_note() -> None:
    section = gallery([], a_world, 1)
    assert section.parts == ()
    assert section.blocks == (Paragraph("No trial failed, or none was selected."),)


@each(
    ("source", "words"),
    [
        ("shipped:box", "sidestep trial --world box --navigator"),
        ("fixed:box_1_000", "sidestep trial --world plant/corpus/fixed/box_1_000.toml"),
        ("kept:ab-mine.toml", "sidestep trial --world STUDY/worlds/ab-mine.toml"),
        (
            "corpus:maze:1:7",
            "sidestep worlds generate --family maze --per-family 8 --seed 1 --out worlds\n"
            "sidestep trial --world worlds/maze_1_007.toml",
        ),
    ],
)
def test_command_names_the_world_of_any_source(source: str, words: str) -> None:
    request = row(world_source=source, navigator="bug", side="right", seed=4, noise="harsh")
    command = command_of(request)
    assert command.startswith(words)
    assert command.endswith("--navigator bug --side right --seed 4 --noise harsh --timeout 300")


def test_command_has_exact_parameters() -> None:
    assert command_of(row(parameters='{"d_obs_m": 0.1234567890123}')).endswith(
        " --param d_obs_m=0.1234567890123"
    )


def test_command_has_the_uncalibrated_option() -> None:
    assert command_of(row(calibrated=False)).endswith(" --uncalibrated")
    assert "calibrated" not in command_of(row())


def test_shipped_worlds_load_by_the_name_in_the_command() -> None:
    assert load(command_of(row(world_source="shipped:u_trap")).split()[3]).name == "u_trap"
