"""Change the world: end all processes, start those of the other world, and drive to its goal."""

from functools import partial

from ground.app.playback.app_interface import AppInterface
from ground.launch.scenario import Scenario


def change_world(interface: AppInterface, scenario: Scenario, what: str) -> None:
    """Restart the processes that this app started with a scenario; `what` goes to the log.

    The end of the old processes is not reported as a loss. The robots are armed and drive to the
    goals of the new world, as at the first start. Changes of the old robots cannot be undone in the
    new ones, and a mission draft belongs to its world.
    """
    stack = interface.stack
    if stack is None:
        return
    interface.commands.begin_world(keeps_draft=scenario.name == stack.scenario.name)
    interface.note(f"{scenario.name}: {what}")
    stack.restarted(scenario, partial(interface.station.begin_again, stack.scenario.robots))
    interface.run_in_background(stack.drive_to_goals, partial(report, interface, scenario))


def report(interface: AppInterface, scenario: Scenario, refusals: list[str]) -> None:
    """Report the goals of the new world, or the refusals."""
    goals = ", ".join(str(one.goal) for one in scenario.scenario_robots)
    interface.note(f"{scenario.name}: to {goals} with {scenario.navigator}")
    for refusal in refusals:
        interface.note(f"{scenario.name}: goal refused: {refusal}")
