"""Half a minute of the soak: the whole fleet, its faults, and the report."""

import argparse

import pytest

from verification.soak import main as soak
from verification.soak.supervised import PLANT, SUPERVISOR

pytestmark = pytest.mark.stack


def test_half_a_minute_of_it_heals_every_time_and_the_log_lacks_no_event() -> None:
    parser = argparse.ArgumentParser()
    soak.add_options(parser)
    report = soak.measure(parser.parse_args(["--minutes", "0.5"]))
    found = {figure.name: figure.median for figure in report.figures}
    assert report.met, report.text()
    assert found["faults after which a robot stayed silent"] == 0
    assert found["events of r1 in the log"] > 10
    assert found["events of r1 that the log lacks"] == 0
    assert found["processes given up"] == 0
    happened, *rest = report.notes
    assert "robot r1 cut off for 4 s" in happened
    roles = {line.split(":")[0] for line in rest}
    assert roles >= {"router", "robot r1", "robot r2", "robot r3", "plant", "recorder r1"}
    assert {"ground r1", "ground r2", SUPERVISOR, PLANT} <= roles
