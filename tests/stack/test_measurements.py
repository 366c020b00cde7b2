"""Benchmarks in their smallest form, first drives, and the cost of the app."""

import argparse
import os
import signal
import sys
from pathlib import Path

import pytest

from checks.__main__ import Benchmark
from checks.flood import under_attack as flood
from checks.harness.crew import ROOT, Crew, alive, children_of, cmdline
from checks.harness.figures import Figure
from checks.harness.processes import Running
from checks.harness.until import until
from checks.speed import app_figures as ground
from checks.speed import codec, latency, lockstep, robot_process, trials

pytestmark = pytest.mark.stack


def figures(benchmark: Benchmark, *words: str) -> dict[str, Figure]:
    parser = argparse.ArgumentParser()
    benchmark.add_options(parser)
    report = benchmark.measure(parser.parse_args(words))
    assert report.text()
    return {figure.name: figure for figure in report.figures}


def test_codec_compares_the_same_bytes() -> None:
    found = figures(codec, "--repetitions", "1", "--rounds", "2")
    assert found["pymavlink / ours, encode + decode"].median > 0


def test_core_times_the_given_number_of_steps() -> None:
    found = figures(trials.STEP, "--world", "open", "--steps", "500", "--repetitions", "1")
    assert 0 < found["brain.step, median of 500"].median <= found["brain.step, worst of 500"].median


def test_trial_runs_without_its_peer() -> None:
    found = figures(trials.TRIAL, "--worlds", "open", "--repetitions", "1", "--no-peer")
    assert found["open, real time"].median > 1


def test_lockstep_drives_to_the_end_of_the_goal() -> None:
    found = figures(lockstep.LOCKSTEP, "--worlds", "open", "--repetitions", "1")
    assert found["open, real time"].median > 0
    assert found["open, tick / (trial's tick + round trip)"].median > 0


def test_breakdown_of_a_tick_names_where_its_time_goes() -> None:
    found = figures(lockstep.BREAKDOWN, "--world", "open", "--repetitions", "1")
    stages = [found[name].median for name, _ in lockstep.STAGES]
    assert min(stages) > 0
    assert found["tick"].median == pytest.approx(sum(stages))
    assert found["plant: frames put"].median == pytest.approx(4, abs=0.1)


def test_latency_sees_an_answer_to_every_tick() -> None:
    found = figures(latency, "--world", "open", "--blocks", "1", "--ticks", "10")
    assert found["ours / floor, p50"].median > 0


def test_a_locked_robot_answers_beside_an_open_one() -> None:
    found = figures(robot_process.MTLS, "--world", "open", "--blocks", "1", "--ticks", "10")
    assert found["locked / open, p50"].median > 0
    assert found["locked with log of refusals / open, p50"].median > 0


def test_jitter_reads_the_robots_own_reports() -> None:
    found = figures(robot_process.JITTER, "--world", "open", "--seconds", "1")
    assert found["normal, ticks"].median > 0
    assert found["SCHED_FIFO, ticks"].median > 0


def test_robot_is_measured_by_the_kernels_account() -> None:
    words = ["--world", "open", "--seconds", "1", "--repetitions", "1", "--hours", "0.02"]
    found = figures(robot_process.ROBOT_PROCESS, *words)
    assert found["resident"].median > 1
    assert "growth over 0.02 simulated h" in found


def test_a_run_over_the_bus_is_the_run_in_process_to_the_last_bit() -> None:
    report = lockstep.DIGEST.measure(argparse.Namespace(worlds=["open"]))
    assert report.met, report.text()


@pytest.mark.realtime
def test_attacks_are_measured_on_an_open_bus_and_behind_locked_doors() -> None:
    words = ("--world", "open", "--seconds", "1", "--presses", "1")
    found = figures(flood, *words, "--doors", "open", "--kinds", "questions")
    found |= figures(flood, *words, "--doors", "locked", "--kinds", "stops")
    for name in ("open, questions", "locked, stops"):
        assert len(found[f"{name}: key to standstill"].values) == 1
        assert found[f"{name}: key to standstill"].median < 1000
        assert found[f"{name}: operator had to give up"].median == 0
        assert found[f"{name}: false acknowledgements"].median == 0
    assert found["open, questions: forged commands acted upon"].median == 0


TOOL = (sys.executable, "-m", "checks.first_drives")
DRIVES_S = 240.0
NAME = "short.toml"
SHORT = """
name = "short"
size_m = [4.0, 3.0]
start = { x_m = 0.7, y_m = 1.1, heading_deg = 0.0 }
goal = { x_m = 1.9, y_m = 1.1, heading_deg = 0.0 }
"""


def busy_processes(running: Running) -> list[int]:
    found = []
    for pid in children_of(running.process.pid):
        try:
            found += [pid] if "checks.harness.processes" in cmdline(pid) else []
        except (FileNotFoundError, ProcessLookupError):
            continue
    return found


def test_first_drives_arrive_with_the_digest_of_the_trial(tmp_path: Path) -> None:
    """Start no busy process: other tests run beside it, and the next test has some."""
    (tmp_path / NAME).write_text(SHORT)
    there = ("env", "-C", str(tmp_path), f"PYTHONPATH={ROOT}")
    words = ("--drives", "2", "--busy", "0", "--parallel", "2", "--worlds", NAME)
    with Crew() as crew:
        drives = crew.execute(*there, *TOOL, *words)
        assert drives.ends(DRIVES_S) == 0, drives.said
        head, _, *rows = drives.said.splitlines()[-5:]
        assert head.startswith("2 first drives beside 0 busy processes on ")
        assert [row.split()[:2] for row in rows[:2]] == [
            [NAME, "app"],
            [NAME, "headless"],
        ]
        assert all("1 of 1" in row and "equal" in row for row in rows[:2])
        assert "2 of 2" in rows[2]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_busy_processes_end_with_the_tool(number: signal.Signals) -> None:
    with Crew() as crew:
        drives = crew.execute(*TOOL, "--drives", "1", "--busy", "2")
        until(lambda: len(busy_processes(drives)) == 2, what="busy processes")
        started = children_of(drives.process.pid)
        os.kill(drives.process.pid, number)
        drives.ends()
        until(lambda: not [pid for pid in started if alive(pid)], what="the end of all")


def app_figures(*words: str) -> dict[str, Figure]:
    parser = argparse.ArgumentParser()
    ground.add_options(parser)
    report = ground.measure(parser.parse_args(words))
    assert report.text()
    return {figure.name: figure for figure in report.figures}


@pytest.mark.realtime
def test_a_driving_robot_costs_little_a_paused_one_less_and_a_slow_line_is_not_flooded() -> None:
    short = ("--seconds", "1", "--settle", "0.3", "--slow-presses", "2", "--repetitions", "1")
    found = app_figures("--parts", "cost", *short)
    for size, cpu, kb in (("80x24", 20.0, 90.0), ("140x40", 32.0, 180.0)):
        assert found[f"CPU of one core, driving, {size}"].median < cpu
        assert 1.0 < found[f"written, driving, {size}"].median < kb
    paused, driving = (found[f"written, {what}, 80x24"].median for what in ("paused", "driving"))
    assert paused < 0.5 * driving  # what its cycles cost goes on changing
    assert found["written, nothing changes, 80x24"].median == 0.0
    assert found["written, slow line, 140x40"].median < 20.5


@pytest.mark.realtime
def test_a_key_holds_the_robot_and_another_one_stops_it() -> None:
    found = app_figures("--parts", "keys", "--presses", "2")
    assert len(found["hold: key to robot acts"].values) == 2
    assert found["e-stop: rolled"].median < found["hold: rolled"].median + 0.05


def test_the_screen_is_painted_and_reacts_in_a_flood_of_lines() -> None:
    words = ("--starts", "1", "--minutes", "0.05", "--lines", "2000", "--presses-after", "4")
    found = app_figures("--parts", "paint", "crowd", *words)
    assert found["first bytes"].median <= found["first paint"].median
    assert len(found["key to screen, after it"].values) >= 4
