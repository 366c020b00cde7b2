"""The search for the worst tick counts bytecodes and finds the same scenarios again."""

import sys

from checks.speed.board.scenarios import MEASURED, TickScenario, bytecodes, run_scenario, search
from robot.hosting import InProcessCore


def test_search_ranks_scenarios_by_their_worst_tick() -> None:
    worst = {number: bytecodes(TickScenario("vgm", number), 30) for number in range(4)}
    best = sorted(worst, key=lambda number: -worst[number])[:MEASURED]
    assert search("vgm", 4, 30) == [("vgm", number) for number in best]
    assert min(worst.values()) > 1000
    assert len(set(worst.values())) > 1


def test_longer_scenario_is_never_cheaper() -> None:
    scenario = TickScenario("bug", 1)
    assert bytecodes(scenario, 20) <= bytecodes(scenario, 60)


def test_search_restores_the_trace_function() -> None:
    before = sys.gettrace()
    bytecodes(TickScenario("bug", 0), 2)
    assert sys.gettrace() is before


def test_scenario_drives_and_is_the_same_again() -> None:
    runs = []
    for _ in range(2):
        scenario = TickScenario("vgm_memory", 1)
        core = InProcessCore(scenario.params())
        body = scenario.body()
        runs.append([core.state.odometry.pose for _ in run_scenario(core, body, 80)])
    assert runs[0] == runs[1]
    assert len(set(runs[0])) > 40
