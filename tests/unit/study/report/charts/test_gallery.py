"""Failures are selected, run again and given with a command to repeat them."""

from plant.model.errors import WorldError, WorldProblem
from plant.world.file import load
from protocol.world import World
from runtime.errors import UserError
from study.report.charts.gallery import command_of, diverse, gallery, kind_of, selected_failures
from study.report.page import Gallery, Paragraph
from study.report.trials import distinct, trials_of
from study.runner.rows import TrialRow
from study.runner.run_task import trial_of
from study.runner.store import table_of
from study.trial.trial import run_trial
from tests.support.each import each
from tests.support.study.made import floor
from tests.support.study.report.made import COLLIDED, GAVE_UP, SHUT, STUCK, row, study


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
