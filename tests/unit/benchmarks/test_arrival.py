"""Arrival in the open meets its limits, and the benchmark measures it."""

from argparse import ArgumentParser

from checks.speed import accuracy
from checks.speed.accuracy import PEER, arrive
from tests.support.each import each


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
