"""Trials, studies, worlds and recordings in Python: typed results that pandas takes."""

import sys
from collections.abc import Callable
from math import inf, nan
from pathlib import Path

import pytest

import sidestep
from checks.harness.messages import make
from plant.world.file import load
from protocol.outcome import RunOutcome
from protocol.wire.messages import MESSAGES, NavigatorStatus, SonarScan
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose
from sidestep.navigators import goal_bearing_rad, towards
from sidestep.table import Table
from study.trial.trial import Trial, run_trial
from tests.support.each import each
from tests.support.ground.made_recordings import mcap, run


def straight(memory: object, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    return towards(goal_bearing_rad(pose, goal), pose, ring, goal)


def test_trial_is_that_of_the_command_line() -> None:
    run = sidestep.trial("box", "bug", side="right", seed=3)
    asked = Trial(world=load("box"), navigator="bug", side="right", seed=3)
    assert run.digest == run_trial(asked).digest
    assert (run.outcome, run.reached, run.navigator) == ("reached", True, "bug")


def test_outcome_of_a_trial_is_one_row_of_a_table() -> None:
    run = sidestep.trial("box", noise="none", goal=(1.4, 2.0))
    assert run.to_dict().keys() == RunOutcome.__dataclass_fields__.keys()
    frame = run.to_pandas()
    assert (len(frame), frame.outcome[0], frame.time_s[0]) == (1, "reached", run.time_s)
    assert frame.shortest_path_m.isna().all()  # the goal is not that of the world


def test_trace_has_a_row_for_each_tick_in_si_units() -> None:
    run = sidestep.trial("box", noise="none", goal=(1.4, 2.0))
    trace = run.trace
    assert len(trace) == run.ticks + 1
    assert trace.columns[-3:] == ["left_rad_s", "right_rad_s", "guard"]
    assert (trace["vehicle"][-1], trace["goal"][-1]) == ("active", "reached")
    assert {"to_goal", "none"} >= set(trace["branch"])
    assert inf in trace["nearest_range_m"]
    assert trace["nearest_bearing_rad"][0] is None
    assert max(one for one in trace["left_rad_s"] if isinstance(one, float)) < 20.0
    assert trace.to_pandas().time_s.is_monotonic_increasing


def test_start_and_goal_are_metres_and_degrees() -> None:
    run = sidestep.trial("open", start=(1.0, 1.0, 90.0), goal=(1.0, 2.0, 180.0), noise="none")
    assert run.trace["true_heading_rad"][0] == pytest.approx(1.5708, abs=1e-4)
    assert abs(float(run.trace["true_heading_rad"][-1] or 0.0)) == pytest.approx(3.1416, abs=0.06)


def test_function_serves_as_a_navigator() -> None:
    assert sidestep.trial("open", straight, noise="none").navigator == "straight"
    found = sidestep.study("open", [straight, "vgm"], noise="none")
    assert {row["navigator"] for row in found.trials} == {"straight", "vgm"}


def test_study_has_a_row_for_each_trial() -> None:
    found = sidestep.study(
        ["open", "box"], ["bug:right", "vgm"], noise=["none", "default"], seeds=2, jobs=1
    )
    assert len(found) == 2 * 2 * (1 + 2)
    frame = found.to_pandas()
    assert set(frame.side) == {"left", "right"}
    summary = found.summary()
    assert [(row["navigator"], row["noise"], row["trials"]) for row in summary] == [
        ("bug", "none", 2),
        ("bug", "default", 4),
        ("vgm", "none", 2),
        ("vgm", "default", 4),
    ]
    assert summary["worlds"] == [2, 2, 2, 2]


def test_study_in_processes_gives_the_same_trials() -> None:
    one, two = (sidestep.study(["open", "box"], "vgm", seeds=1, jobs=jobs) for jobs in (1, 2))
    assert sorted(map(str, one.trials["digest"])) == sorted(map(str, two.trials["digest"]))


def test_kept_study_continues(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    first = sidestep.study("open", "vgm", noise="none", jobs=1, output=folder)
    again = sidestep.study("open", "vgm", noise="none", jobs=1, output=folder)
    assert again.trials["started_utc"] == first.trials["started_utc"]
    said = "holds a study with other settings: seeds was 1, is 2; choose another output$"
    with pytest.raises(sidestep.UserError, match=said):
        sidestep.study("open", "vgm", noise="none", seeds=2, jobs=1, output=folder)


def test_worlds_are_a_mapping_and_a_table() -> None:
    assert "u_trap" in sidestep.worlds
    assert list(sidestep.worlds) == sidestep.worlds.to_dict()["name"]
    assert sidestep.worlds["box"].size_m == (6.0, 4.0)
    assert "box" in repr(sidestep.worlds)


@each(
    ("call", "said"),
    [
        (lambda: sidestep.trial("bxo"), "no such world: 'bxo'; did you mean 'box'?"),
        (lambda: sidestep.worlds["bxo"], "did you mean 'box'?"),
        (lambda: sidestep.trial("no.toml"), "no.toml: there is no such world file"),
        (lambda: sidestep.trial("box", "vmg"), "no such navigator: 'vmg'; did you mean 'vgm'?"),
        (lambda: sidestep.trial("box", "no.py"), "no.py: there is no such file"),
        (lambda: sidestep.trial(seed=-1), "seed = -1: must be a whole number from 0 on"),
        (lambda: sidestep.trial(seed=1.5), "seed = 1.5: must be a whole number"),  # type: ignore[arg-type]
        (lambda: sidestep.trial(timeout_s=nan), "timeout_s = nan: must be a finite number above"),
        (lambda: sidestep.trial(noise="loud"), "no such noise level: 'loud'"),
        (lambda: sidestep.trial(side="up"), "no such side: 'up'; there are left, right"),
        (lambda: sidestep.trial(goal=(99.0, 0.0)), "lies outside the world box"),
        (lambda: sidestep.trial(goal=(1.0,)), "give (x_m, y_m) or (x_m, y_m, heading_deg)"),  # type: ignore[arg-type]
        (lambda: sidestep.trial(parameters={"v": 1.0}), "parameters: there is no parameter «v»"),
        (lambda: sidestep.study("box", parameters={"v": 1.0}), "parameters, or [robot] of box:"),
        (lambda: sidestep.study("bxo"), "no such world or directory: 'bxo'"),
        (lambda: sidestep.study([]), "worlds is empty: name one, as in sidestep.study('box', "),
        (lambda: sidestep.study("box", []), "navigators is empty: name one"),
        (lambda: sidestep.study("box", noise=[]), "noise is empty: name one"),
        (lambda: sidestep.study("box", 5), "navigator = 5: give the name of a navigator"),  # type: ignore[arg-type]
        (lambda: sidestep.study(5), "world = 5: give the name of a world"),  # type: ignore[arg-type]
        (lambda: sidestep.study("box", "bug:up"), "no such side: 'up'; there are left, right"),
        (lambda: sidestep.study("box", ""), "no such navigator: ''"),
        (lambda: sidestep.study(""), "no such world or directory: ''"),
        (lambda: sidestep.trial(None), "world = None: give the name of a world, the path"),  # type: ignore[arg-type]
        (lambda: sidestep.trial(""), "no such world: ''"),
        (lambda: sidestep.worlds.load(3), "path = 3: give the path of a world file"),  # type: ignore[arg-type]
        (lambda: sidestep.trial("box", 5), "navigator = 5: give the name of a navigator"),  # type: ignore[arg-type]
        (lambda: sidestep.trial("box", "bug:up"), "no such side: 'up'; there are left, right"),
        (lambda: sidestep.trial("box", "bug:left"), "give 'bug' and side='left'"),
        (lambda: sidestep.trial(noise=["none"]), "no such noise level"),  # type: ignore[arg-type]
        (lambda: sidestep.trial(start="abc"), "start = 'abc': give (x_m, y_m, heading_deg)"),  # type: ignore[arg-type]
        (lambda: sidestep.trial(start=5), "start = 5: give (x_m, y_m, heading_deg)"),  # type: ignore[arg-type]
        (lambda: sidestep.trial(goal=(2.0, 1.0, 1e9)), "goal: heading 1e+09 deg is out of range"),
        (
            lambda: sidestep.trial(parameters={"v_max_m_s": "fast"}),  # type: ignore[dict-item]
            "parameters: v_max_m_s = 'fast': must be a number",
        ),
        (lambda: sidestep.study("box", parameters=[1]), "parameters = [1]: give a dict"),  # type: ignore[arg-type]
        (lambda: sidestep.study("open", jobs=1).report(), "report() needs files"),
        (lambda: sidestep.study("open", straight, output="x"), "needs the file of a navigator"),
        (lambda: Table({"a": [1]})["b"], "there is no column 'b': there are a"),
        (lambda: Table({"a": [1]})[0], "by name: list(table)[0] is its first row"),  # type: ignore[index]
        (lambda: sidestep.open_recording("no.mcap"), "no.mcap: No such file"),
    ],
)
def test_errors_speak_python(call: Callable[[], object], said: str) -> None:
    with pytest.raises(sidestep.UserError) as error:
        call()
    assert said in str(error.value)
    assert "--" not in str(error.value)


def test_bad_world_file_is_an_error_of_the_user(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("size_m = 3\n", encoding="utf-8")
    for call in (sidestep.trial, sidestep.worlds.load, sidestep.study):
        with pytest.raises(sidestep.UserError, match=r"bad\.toml:1: size_m: .*fix: "):
            call(bad)


def test_notebook_shows_results_as_maps_and_tables() -> None:
    run = sidestep.trial("box", noise="none", goal=(1.4, 2.0))
    assert "<svg" in sidestep.worlds["box"]._repr_svg_()
    assert "polyline" in run._repr_svg_()
    assert run._repr_html_().startswith("<p>reached the goal of box")
    assert "<th>shortest_path_m</th>" in sidestep.worlds._repr_html_()
    assert "<p>31 rows</p>" in Table({"a": [*range(30), None]})._repr_html_()


def test_plots_are_figures() -> None:
    run = sidestep.trial("box", noise="none", goal=(1.4, 2.0))
    figure = run.plot()
    assert len(figure.axes) == 5
    assert vars(figure)["_repr_png_"]().startswith(b"\x89PNG")
    (axes,) = sidestep.study("open", "vgm", noise="none", jobs=1).plot().axes
    assert [text.get_text() for text in axes.texts] == [" 1 of 1 in 1 worlds"]


def test_missing_pandas_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(sidestep.UserError, match=r"pip install 'sidestep\[pandas\]'"):
        Table({"a": [1]}).to_pandas()


SCAN = SonarScan(
    time_ns=1_500_000_000,
    seq=1,
    range_mm=(400, 0, 250, 0, 0, 0, 0, 0),
    ping_age_us=(1000,) * 8,
    valid=0b11111101,
    echo=0b00000101,
)


def test_ranges_are_metres_with_inf_and_none() -> None:
    assert SCAN.ranges_m == (0.4, None, 0.25, inf, inf, inf, inf, inf)
    fields = SCAN.to_dict()
    assert (fields["time_s"], fields["range_m[0]"], fields["range_m[1]"]) == (1.5, 0.4, None)
    assert fields["ping_age_s[7]"] == 0.001


def test_nan_of_a_message_is_none() -> None:
    found = make(NavigatorStatus, goal_x_m=nan, goal_y_m=1.0).to_dict()
    assert (found["goal_x_m"], found["goal_y_m"]) == (None, 1.0)


@each("kind", MESSAGES)
def test_every_message_has_fields_in_si_units(kind: type[sidestep.Message]) -> None:
    names = make(kind).to_dict()
    assert names
    assert not [
        one for one in names if one.partition("[")[0].endswith(("_ns", "_mm", "_us", "_ms"))
    ]


def test_recording_gives_a_table_for_each_topic(tmp_path: Path) -> None:
    found = sidestep.open_recording(mcap(tmp_path / "a.mcap", list(run(60))))
    assert (found.robot, found.duration_s, found.damage) == ("r1", 2.95, "")
    assert found.world is not None
    odometry = found["odometry"]
    assert len(odometry) == len(list(found.messages("tlm/odometry")))
    assert {"time_s", "x_m", "heading_rad"} < set(odometry.columns)
    assert found.to_pandas("odometry").x_m.is_monotonic_increasing
    assert found.to_dict("odometry")["x_m"] == odometry["x_m"]
    assert set(found.summary()["topic"]) == set(found.topics)
    assert "polyline" in found._repr_html_()
    assert len(found.plot().axes) == 5
    assert list(found) == found.topics
    said = "there is no topic 'nope': there are wheels, sonar, .*, tlm/heartbeat, op/heartbeat, "
    with pytest.raises(sidestep.UserError, match=said):
        found["nope"]


@each("content", [b"", b"\x89", b"x", b"\x89MCAP0\r\n", b"no recording" * 99])
@each("name", ["a.mcap", "a.tlog"])
def test_recording_without_a_message_is_refused(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(sidestep.UserError, match=f"{name}: holds no message of a robot"):
        sidestep.open_recording(tmp_path / name)


def test_recording_that_is_cut_says_so(tmp_path: Path) -> None:
    whole = mcap(tmp_path / "a.mcap", list(run(60)))
    assert "damaged" not in repr(sidestep.open_recording(whole))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    assert repr(sidestep.open_recording(cut)).endswith(" s, damaged>")
