"""Every benchmark measures something, in its smallest form; no threshold is asserted here."""

import argparse

import pytest

from checks.__main__ import Benchmark
from checks.flood import under_attack as flood
from checks.harness.figures import Figure
from checks.same_bits import run_modes
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
    report = run_modes.measure(argparse.Namespace(worlds=["open"]))
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
