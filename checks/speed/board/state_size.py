"""Size of the state that a navigator keeps from tick to tick, as on the heap of the board.

The scenarios of the search run in this process, and `memory_size` counts the objects of the
navigator after every tick. The result is the largest state found.
"""

from typing import Final

from checks.speed.board.memory_size import heap_bytes
from checks.speed.board.scenarios import Scenario, run_scenario
from robot.hosting import InProcessCore

SCENARIOS: Final = 4
TICKS: Final = 80


def state_bytes(navigator: str, scenarios: int = SCENARIOS, ticks: int = TICKS) -> int:
    """Return the largest state of a navigator in bytes."""
    most = 0
    for number in range(scenarios):
        scenario = Scenario(navigator, number)
        core = InProcessCore(scenario.params())
        estimate = {id(core.state.odometry)}  # the robot's, which a proof only reads
        for _ in run_scenario(core, scenario.body(), ticks):
            most = max(most, heap_bytes(core.state.memory, set(estimate)))
    return most
