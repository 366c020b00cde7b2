"""The benchmarks: what each measures, their table, page and exit codes."""

import json
import sys
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Sequence
from functools import partial
from math import pi
from pathlib import Path
from time import time_ns
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from rich.text import Text

from checks.__main__ import BENCHMARKS, benchmark_of, main
from checks.evidence import EVIDENCE, FIGURES, GATEWAY, LONG_FIGURES, ROOT, TICK
from checks.harness.figures import BenchmarkReport, Figure
from checks.harness.mavlink_client import FrameArrival, stamp_now
from checks.harness.terminal import Terminal
from checks.site import figures_page
from checks.speed import accuracy
from checks.speed import app_figures as ground
from checks.speed import map_drawing as benchmark
from checks.speed.accuracy import KINDS as ACCURACY_KINDS
from checks.speed.accuracy import PEER, Array, arrive, bounds, consistency_of, speeds_of
from checks.speed.app_figures import first, held, sizes_mb, stopped
from checks.speed.gateway import gateway_figures, reactions
from checks.speed.gateway.forgery import KINDS, Forger, command, sign
from checks.speed.gateway.gateway_figures import KINDS as FLOODS
from checks.speed.gateway.gateway_figures import SUPPLY, FrameFloodRun, supply_of
from checks.speed.gateway.reactions import first_ns
from checks.speed.gateway.stage import position_target
from checks.speed.lockstep import STAGES, ThreadCost, Usage, difference, points_ns, stages_us
from checks.speed.map_drawing import (
    PlotextMap,
    driving_trails,
    measure_frames,
    moving_trails,
    recorded_canvas,
    segments,
)
from checks.speed.stages import measured
from checks.speed.trials import RAYS, Measured, compiled_figures, page, scene_of, table
from gateways.mavlink.framing import Deframer, MavFrame
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.motion.setpoints import Velocity, attitude_of, setpoint_of
from gateways.mavlink.signing import PER_S, SignatureVerdict, StampClock, Verifier
from ground.app.widgets.map import MapWidget
from ground.client.goal import Destination
from ground.missions.mission import Home
from protocol.wire.message import Message
from protocol.wire.messages import WheelCommand
from protocol.world import GoalPose, Polyline, Start, World, WorldCircle, WorldPolygon
from runtime.units import NS_PER_S, PERIOD_S
from tests.support.each import each

KEY = bytes(range(100, 132))
HOME = Home(latitude_deg=-35.0, longitude_deg=149.0)


def wheels(left_mrad_s: int) -> WheelCommand:
    return WheelCommand(
        time_ns=1, seq=1, sense_seq=1, left_mrad_s=left_mrad_s, right_mrad_s=0, ttl_ms=150
    )


def frames_in(data: list[bytes]) -> tuple[list[MavFrame], Deframer]:
    found: list[MavFrame] = []
    deframer = Deframer()
    for one in data:
        deframer.allowance = 10_000
        deframer.feed(one)
        found += deframer.take(0)
    return found, deframer


def owners(*stamps: int) -> list[bytes]:
    encoder = mavlink.MAVLink(None, 255, 190)
    found = []
    for stamp in stamps:
        sign(encoder, KEY, stamp, 0)
        found.append(bytes(command(mavlink.MAV_CMD_MISSION_START).pack(encoder)))
    return found


def test_every_part_can_be_selected() -> None:
    parser = ArgumentParser()
    gateway_figures.add_options(parser)
    assert parser.parse_args(["--parts", "goto", "cost"]).parts == ["goto", "cost"]
    assert set(parser.parse_args([]).parts) == set(gateway_figures.PARTS)


def test_first_wheel_command_that_turns_after_the_send_counts() -> None:
    seen = [(wheels(5), 10), (wheels(0), 20), (wheels(7), 30)]
    assert first_ns(seen, 15) == 30
    assert first_ns(seen, 30) is None


def test_position_target_is_the_place_in_the_robots_world() -> None:
    found = setpoint_of(position_target(3.0, 2.0), None, HOME)
    assert found == Destination(x_m=3.0, y_m=2.0, heading_rad=None)


def test_setpoints_drive_ahead() -> None:
    assert setpoint_of(reactions.velocity(1.0), None, HOME) == Velocity(0.4)
    assert attitude_of(reactions.attitude(0.5), 0.4).speed_m_s == pytest.approx(0.2)
    assert reactions.stick(-1.0).z == -1000
    assert reactions.channels(1.0).chan3_raw == 2000


@each("kind", KINDS)
def test_no_forged_frame_is_valid(kind: str) -> None:
    captured = owners(*(stamp_now() + number for number in range(1, 20)))
    clock = StampClock(time_ns)
    verifier = Verifier(clock, (KEY,))
    verifier.check(frames_in(captured)[0][-1])
    forged = list(Forger(KEY, captured, (1, 1)).frames(kind, 60))
    found, _ = frames_in(forged)
    assert SignatureVerdict.VALID not in {verifier.check(frame) for frame in found}
    assert len(found) == (60 if kind != "truncated" else len(found))
    (good,) = frames_in(owners(stamp_now() + PER_S))[0]
    assert verifier.check(good) is SignatureVerdict.VALID


@each("kind", FLOODS)
def test_floods_are_what_they_are_called(kind: str) -> None:
    found, deframer = frames_in(supply_of(kind))
    counts = {"valid": len(found), "broken": deframer.malformed, "unknown": deframer.unknown}
    assert counts[kind] >= SUPPLY * 0.6
    assert kind == "valid" or len(found) < SUPPLY * 0.2


def test_flood_holds_no_command_that_all_may_give() -> None:
    decoder = mavlink.MAVLink(None)
    names = Counter(
        (message.get_type(), getattr(message, "command", 0))
        for message in (decoder.decode(bytearray(frame)) for frame in supply_of("valid"))
    )
    assert ("COMMAND_LONG", mavlink.MAV_CMD_DO_FLIGHTTERMINATION) not in names
    assert ("PARAM_REQUEST_READ", 0) in names


def test_most_bytes_of_any_second_are_found() -> None:
    times_s = (0.0, 0.5, 1.2, 1.3, 1.4, 3.0)
    arrivals = [FrameArrival(round(at_s * NS_PER_S), 0, 100) for at_s in times_s]
    assert gateway_figures.most_in_a_second(arrivals) == 400


def test_slow_line_that_is_silent_for_long_misses() -> None:
    number = mavlink.MAVLINK_MSG_ID_HEARTBEAT
    arrivals = [FrameArrival(at_s * NS_PER_S, number, 21) for at_s in (0, 1, 4)]
    longest = next(
        one
        for one in gateway_figures.line_figures_of("line", arrivals)
        if one.name == "line: between HEARTBEAT, longest"
    )
    assert longest.values == (3.0,)
    assert longest.met is False


def test_missed_tick_in_a_flood_misses() -> None:
    figures = gateway_figures.flood_figures_of(
        "mixed", FrameFloodRun(missed=1, ticks=100, stops_ms=[80.0])
    )
    assert [one.name for one in figures if one.met is False] == ["mixed: ticks missed of 100"]


def played_wheels(speed_mrad_s: int) -> Message:
    return WheelCommand(
        time_ns=1, seq=1, sense_seq=1, left_mrad_s=speed_mrad_s, right_mrad_s=0, ttl_ms=150
    )


def test_terminal_counts_output_and_times_words() -> None:
    with Terminal(("--version",), (80, 24)) as terminal:
        at_ns = terminal.shown("sidestep", 20.0)
        assert terminal.begun_ns < terminal.first_ns <= at_ns
        assert terminal.text().startswith("sidestep")


def test_output_is_read_after_the_process_has_ended() -> None:
    with Terminal(("--version",), (80, 24), most_per_s=20) as terminal:
        assert terminal.shown("sidestep", 20.0) > terminal.first_ns


def test_missing_words_raise_an_error_with_the_screen() -> None:
    with (
        Terminal(("no-such-verb",), (80, 24)) as terminal,
        pytest.raises(RuntimeError, match="not on the screen: 'Palette'"),
    ):
        terminal.shown("Palette", 20.0)


def test_first_reaction_after_the_key_counts() -> None:
    seen = [
        (played_wheels(0), 10),
        (played_wheels(900), 20),
        (played_wheels(0), 40),
        (played_wheels(0), 50),
    ]
    assert first(seen, 15, stopped) == 40
    assert first(seen, 50, stopped) is None
    assert not held(played_wheels(0))


def test_memory_is_read_after_each_tenth() -> None:
    sizes = sizes_mb(0.1, 12_000)
    assert len(sizes) == 11
    assert sizes[-1] - sizes[1] < 40.0


def test_every_part_of_the_station_can_be_selected() -> None:
    parser = ArgumentParser()
    ground.add_options(parser)
    assert parser.parse_args(["--parts", "paint", "cost"]).parts == ["paint", "cost"]
    assert set(parser.parse_args([]).parts) == set(ground.PARTS)


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


@each(
    ("degrees_of_freedom", "count", "low", "high"),
    [(3, 10, 1.6791, 4.6979), (2, 50, 1.48444, 2.59122), (3, 200, 2.6698, 3.3490)],
)
def test_bounds_agree_with_chi_square_tables(
    degrees_of_freedom: int, count: int, low: float, high: float
) -> None:
    assert bounds(degrees_of_freedom, count) == pytest.approx((low, high), rel=0.01)


def drawn(scale: float, count: int = 400) -> list[tuple[Array, Array]]:
    """Return errors whose stated covariance is `scale` times the true one."""
    rng = np.random.default_rng(5)
    p = np.array([[4e-4, 1e-4, 2e-4], [1e-4, 9e-4, 3e-4], [2e-4, 3e-4, 4e-4]])
    return [(rng.multivariate_normal(np.zeros(3), p), scale * p) for _ in range(count)]


def test_errors_of_the_stated_covariance_are_consistent() -> None:
    found = consistency_of(drawn(1.0))
    assert found.consistent
    assert found.inside == pytest.approx(0.95, abs=0.03)


@each("scale", [0.7, 1.5])
def test_wrong_covariance_is_inconsistent(scale: float) -> None:
    assert not consistency_of(drawn(scale)).consistent


@each("kind", ACCURACY_KINDS[:3])
def test_speed_scripts_end_at_rest_within_wheel_limits(
    kind: str,
) -> None:
    for seed in range(20):
        speeds = list(speeds_of(kind, np.random.default_rng(seed)))
        assert speeds[-10:] == [(0.0, 0.0)] * 10
        assert max(abs(speed) for pair in speeds for speed in pair) <= 0.30
        assert 50 < len(speeds) < 1200


@each("noise", ["none", "default"])
@each("navigator", ["bug", "vgm", "vgm_memory"])
def test_arrives_within_3_cm_and_2_degrees(navigator: str, noise: str) -> None:
    for seed in range(5):
        one = arrive(seed, noise, navigator)
        assert one.reached
        assert one.position_m <= 0.03
        assert one.heading_deg <= 2.0
        assert one.turned_deg <= 5.0


def test_without_pose_controller_the_robot_turns_last() -> None:
    assert max(arrive(seed, "none", "vgm", PEER).turned_deg for seed in range(3)) > 30.0


def test_only_the_robot_is_compared_with_thresholds() -> None:
    parser = ArgumentParser()
    accuracy.add_arrival_options(parser)
    report = accuracy.measure_arrival(parser.parse_args(["--poses", "2", "--noises", "none"]))
    judged = {figure.name: figure.met for figure in report.figures if figure.met is not None}
    assert judged == {
        "none: not reached": True,
        "none: position, worst": True,
        "none: heading, worst": True,
        "none: last turn over 5 deg": True,
    }
    assert sum(figure.name.startswith("go-then-align") for figure in report.figures) == 8


class Stub(ModuleType):
    """A benchmark with a fixed result."""

    def __init__(self, value: float) -> None:
        super().__init__("checks.speed.codec")
        self.value = value

    def add_options(self, parser: ArgumentParser) -> None:
        parser.add_argument("--steps", type=int, default=1)

    def measure(self, options: Namespace) -> BenchmarkReport:
        figure = Figure(name="n", unit="x", values=(self.value * options.steps,), at_least=10.0)
        return BenchmarkReport(benchmark="codec", figures=(figure,))


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    module = Stub(10.0)
    monkeypatch.setitem(sys.modules, "checks.speed.codec", module)
    return module


@each("name", BENCHMARKS)
def test_every_name_in_the_table_is_a_benchmark(name: str) -> None:
    benchmark = benchmark_of([name])
    assert benchmark is not None
    benchmark.add_options(ArgumentParser())
    assert callable(benchmark.measure)


def test_missed_threshold_is_exit_code_1(stub: Stub, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["codec"]) == 0
    stub.value = 9.0
    assert main(["codec"]) == 1
    assert "MISSED" in capsys.readouterr().out


def test_json_contains_the_machine(stub: Stub, capsys: pytest.CaptureFixture[str]) -> None:
    main(["codec", "--json", "--steps", "3"])
    report = json.loads(capsys.readouterr().out)
    assert report["figures"][0]["median"] == 30.0
    assert {"cpu", "cores", "python", "load"} <= set(report["machine"])


@pytest.mark.parametrize("arguments", [[], ["nonsense"], ["codec", "--nonsense"]])
def test_wrong_usage_is_exit_code_2(stub: Stub, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(arguments)
    assert refused.value.code == 2


PACES = {"compiled": 10.0, "pure": 2.0, "before": 1.0}


def reply(pace: float, digest: str = "d") -> dict[str, Any]:
    stages_us = {"core": 30.0 / pace, "rest": 20.0 / pace}
    return {"pace": pace, "digest": digest, "whole_us": 50.0 / pace, "stages_us": stages_us}


def test_stages_and_rest_add_up_to_the_whole_trial() -> None:
    found = measured("open")
    assert not found["compiled"]
    assert len(found["digest"]) == 64
    stages_us = found["stages_us"]
    assert {"core", "sonar rays", "wheels", "clearance", "score", "rest"} < stages_us.keys()
    assert abs(sum(stages_us.values()) - found["whole_us"]) < 1e-9
    assert all(cost > 0.0 for name, cost in stages_us.items() if name != "rest")


def test_ratios_are_those_of_neighbours_and_digests_are_compared() -> None:
    found: Measured = {
        "compiled": [reply(2000.0), reply(4000.0)],
        "pure": [reply(500.0), reply(1000.0, "other")],
        "ir-sim": [50.0, 100.0],
    }
    figures = {figure.name: figure for figure in compiled_figures("w", found)}
    assert figures["w, compiled / pure"].values == (4.0, 4.0)
    assert figures["w, compiled / ir-sim"].values == (40.0, 40.0)
    assert figures["w, pure / ir-sim"].met
    assert figures["w, equal digests"].met is False


def test_the_table_shows_each_stage_of_each_child() -> None:
    found: Measured = {name: [reply(pace)] for name, pace in PACES.items()}
    found["ir-sim"] = []
    lines = table("w", found).splitlines()
    assert lines[2] == "| stage | before, us | pure, us | compiled, us |"
    assert "| core | 30.0 | 15.0 | 3.0 |" in lines
    assert lines[-1] == "| whole trial | 50.0 | 25.0 | 5.0 |"
    text = page(["## w"], list(compiled_figures("w", found)))
    assert "| w, compiled | 10 x | 10 to 10 | 2000 |" in text
    assert text.endswith("\n## w\n")


TICK_NS = 100_000
POINTS = [point for _, point in STAGES[:-1]]


def notes_of(ticks: int) -> dict[str, list[tuple[str, int]]]:
    """Return notes that are 10 us apart."""
    notes: list[tuple[str, int]] = []
    for tick in range(ticks):
        begin_ns = tick * TICK_NS
        notes.append(("publish", begin_ns))
        notes += [(point, begin_ns + 10_000 * place) for place, point in enumerate(POINTS, 1)]
    return {"plant": notes, "robot": []}


def test_stages_add_up_to_the_tick() -> None:
    stages = stages_us(notes_of(9))
    assert stages == [10.0] * len(POINTS) + [20.0]
    assert sum(stages) * 1e3 == TICK_NS


def test_ticks_without_one_of_the_points_are_left_out() -> None:
    notes = notes_of(9)
    whole = stages_us(notes)
    notes["plant"] = [note for index, note in enumerate(notes["plant"]) if index != 3]
    assert stages_us(notes) == whole
    passed = [(point, time_ns) for time_ns, point in enumerate(POINTS)]
    assert points_ns(passed, 100) is not None
    assert points_ns(passed[1:], 100) is None
    assert points_ns([*passed, passed[-1]], 100) is None


def test_stage_ends_at_the_latest_when_the_next_one_does() -> None:
    passed = [(point, 10 * time_ns) for time_ns, point in enumerate(POINTS)]
    passed[0] = (passed[0][0], 15)
    ends = points_ns(passed, 200)
    assert ends is not None
    assert ends[:3] == [10, 10, 20]


def test_usage_is_the_difference_of_two_readings() -> None:
    before, after = (
        Usage(ThreadCost(5, 1), ThreadCost(7, 2)),
        Usage(ThreadCost(50, 11), ThreadCost(17, 3)),
    )
    assert difference(after, before) == Usage(ThreadCost(45, 10), ThreadCost(10, 1))


REPORT = BenchmarkReport(
    benchmark="codec",
    figures=(
        Figure(name="ratio", unit="x", values=(4.0, 3.0, 5.0), at_least=3.0),
        Figure(name="cost", unit="us", values=(2.5,), at_most=2.0),
        Figure(name="shown", unit="", values=(1.0,)),
    ),
    notes=("byte-identical",),
    machine={"cores": 2},
)


EMPTY = f"# Page\n\n{figures_page.BEGIN}{figures_page.END}\nthe end\n"


def reported(arguments: Sequence[str]) -> dict[str, Any]:
    return REPORT.as_json() | {"benchmark": arguments[0]}


def test_met_and_missed_figures_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures_page, "measured", reported)
    output = tmp_path / "figures.md"
    output.write_text(EMPTY)
    assert figures_page.main(["codec", "--output", str(output)]) == 0
    text = output.read_text()
    assert text.startswith("# Page\n")
    assert text.endswith("\nthe end\n")
    assert "| ratio | 4 x | 3 to 5 | >= 3 | met |" in text
    assert "| cost | 2.5 us |  | <= 2 | **missed** |" in text
    assert "| shown | 1 |  |  |  |" in text
    assert f"\n## codec: {BENCHMARKS['codec'].title}\n" in text
    assert "`sidestep bench codec`, cores 2" in text
    assert "- byte-identical" in text


def test_a_benchmark_that_breaks_down_leaves_the_old_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures_page, "measured", lambda _: None)
    output = tmp_path / "figures.md"
    output.write_text(EMPTY)
    assert figures_page.main(["codec", "--output", str(output)]) == 1
    assert output.read_text() == EMPTY


def test_missing_report_is_printed_with_its_exit_code(capfd: pytest.CaptureFixture[str]) -> None:
    assert figures_page.measured(["nonsense"]) is None
    assert "exit code 2" in capfd.readouterr().err


def test_section_is_replaced_in_the_order_of_the_benchmarks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures_page, "measured", reported)
    output = tmp_path / "figures.md"
    output.write_text(
        EMPTY.replace(figures_page.END, f"a table written by hand\n{figures_page.END}")
    )
    assert figures_page.main(["nees", "core", "--output", str(output)]) == 0
    text = output.read_text()
    assert "by hand" not in text
    assert text.index("\n## core: ") < text.index("\n## nees: ")
    monkeypatch.setattr(
        figures_page, "measured", lambda words: reported(words) | {"notes": ["newer"]}
    )
    assert figures_page.main(["core", "--output", str(output)]) == 0
    new = output.read_text()
    assert new.count("\n## core: ") == new.count("- newer") == new.count("- byte-identical") == 1
    assert new.index("- newer") < new.index("\n## nees: ")


def test_figures_are_measured_by_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures_page, "measured", reported)
    output = tmp_path / "figures.md"
    output.write_text(EMPTY)
    assert figures_page.main(["--output", str(output)]) == 0
    assert [found[1] for found in figures_page.SECTION.finditer(output.read_text())] == list(
        FIGURES
    )


def test_every_benchmark_is_on_a_page_of_evidence() -> None:
    sections = (*FIGURES, *LONG_FIGURES, *TICK, *GATEWAY)
    whole = ("compiled", "faults")
    assert sorted((*sections, *whole)) == sorted(BENCHMARKS)
    assert {*whole} <= {one.name for one in EVIDENCE}


@each("name", ["figures", "long-figures", "lockstep", "mavlink-gateway"])
def test_committed_page_has_marks_for_its_sections(name: str) -> None:
    text = (ROOT / "docs" / "evidence" / f"{name}.md").read_text(encoding="utf-8")
    assert text.count(figures_page.BEGIN) == text.count(figures_page.END) == 1


def test_growth_is_measured_over_ten_hours() -> None:
    assert figures_page.OPTIONS["robot"] == ("--hours", "10")


CORNERS = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))


def world(*, walls: bool) -> World:
    return World(
        name="w",
        size_m=(6.0, 4.0),
        start=Start(x_m=0.6, y_m=2.0, heading_rad=0.5),
        goal=GoalPose(x_m=5.4, y_m=2.0),
        walls=walls,
        obstacles=(
            WorldCircle(x_m=3.0, y_m=1.0, radius_m=0.25),
            WorldPolygon(CORNERS),
            Polyline(CORNERS),
        ),
    )


def test_scene_has_all_obstacles_and_outer_walls() -> None:
    shapes = [obstacle["shape"]["name"] for obstacle in scene_of(world(walls=False))["obstacle"]]
    assert shapes == ["circle", "polygon", "linestring"]
    walled = scene_of(world(walls=True))["obstacle"]
    assert len(walled) == 4
    assert walled[-1]["shape"]["vertices"][2] == [6.0, 4.0]


def test_scene_has_our_robot_and_sensor() -> None:
    scene = scene_of(world(walls=True))
    (robot,) = scene["robot"]
    (lidar,) = robot["sensors"]
    assert robot["shape"] == {"name": "circle", "radius": 0.12}
    assert robot["state"] == [0.6, 2.0, 0.5]
    assert (lidar["number"], lidar["range_max"], lidar["angle_range"]) == (RAYS, 3.0, pi)
    assert scene["world"]["step_time"] == PERIOD_S == 0.05


def test_scene_is_valid_json() -> None:
    scene = scene_of(world(walls=True))
    assert json.loads(json.dumps(scene)) == scene
