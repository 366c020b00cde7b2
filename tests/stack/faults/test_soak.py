"""A short soak: the whole fleet, its faults, and the report."""

import argparse

import pytest

from checks.endurance import soak
from checks.endurance import soak as soak_report
from checks.endurance.supervised import PLANT, SUPERVISOR
from runtime.units import NS_PER_S

PATIENCE_S = 60.0

pytestmark = pytest.mark.stack


def test_it_heals_after_each_fault_and_the_log_lacks_no_event(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The fleet may heal slowly, as the machine may be busy."""
    monkeypatch.setattr(soak, "HEALED_S", PATIENCE_S)
    monkeypatch.setattr(soak, "READY_NS", PATIENCE_S * NS_PER_S)
    monkeypatch.setattr(soak_report, "HEALED_S", PATIENCE_S)
    parser = argparse.ArgumentParser()
    soak.add_options(parser)
    report = soak.measure(parser.parse_args(["--minutes", "0.25"]))
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
