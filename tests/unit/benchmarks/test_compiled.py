"""Stages of a trial are measured and shown side by side."""

from typing import Any

from checks.speed.stages import measured
from checks.speed.trials import Measured, compiled_figures, page, table

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
