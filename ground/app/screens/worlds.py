"""Show the Worlds screen: preview a world, and start it if this app started the processes.

To change the world, all processes end, those of the other world start, and the robot drives to its
goal. The facts about a world come from the plant, and from the outcomes of the study.
"""

import os
from collections.abc import Mapping, Sequence
from functools import partial
from math import degrees
from pathlib import Path
from textwrap import wrap
from typing import Any, Final

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical

from ground.app.app_interface import AppInterface
from ground.app.input.key_queue import SecondPress, confirmation
from ground.app.input.keymap import Layer
from ground.app.lists.table import Column, ColumnHeads, Table
from ground.app.panels.aged import number
from ground.app.screens.app_screen import Action
from ground.app.screens.list_screen import ListScreen
from ground.app.widgets.lines import Lines, ListView
from ground.app.widgets.map import MapWidget
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.launch.child_command import command
from ground.launch.scenario import Scenario, world_facts
from ground.map.scene import MapScene
from ground.station.scene import preview_of
from ground.station.world import shown
from protocol.world import World, WorldCircle, world_in


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


OUTCOMES: Final = Path(__file__).parents[3] / "docs" / "evidence" / "outcomes.md"
NOISE: Final = "default"
COLUMNS: Final = 10
"""World, navigator, noise, seven columns of results, and the outcomes of ten seeds."""

Reached = dict[str, dict[str, int]]


def query_worlds(*words: str) -> dict[str, Any]:
    """Return the JSON of `sidestep worlds`. Raise UserError with its message when it fails."""
    return world_facts(command(["worlds", *words, "--json"], os.getpid()))


def read_reached_counts(path: Path = OUTCOMES) -> Reached:
    """Return, by world and navigator, how many of ten seeds reached the goal with default noise.

    Empty without a source tree, which contains the outcomes of the study.
    """
    found: Reached = {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return found
    for line in lines:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == COLUMNS and cells[2] == NOISE:
            found.setdefault(cells[0], {})[cells[1].replace(",", "")] = reached_count(cells[-1])
    return found


def reached_count(ends: str) -> int:
    """Return 7 for `7 reached, 3 stuck`."""
    counts = (end.partition(" ") for end in ends.split(", "))
    return sum(int(count) for count, _, how in counts if how == "reached")


REACHED: Final = "reached of 10 seeds: "
RESTARTS: Final = "s, pressed twice: stop this run and start the selected world"
NOT_OURS: Final = "this app did not start the processes, so it cannot restart them"


class WorldsScreen(ListScreen[Mapping[str, str]]):
    """The list of worlds, with a preview and facts of the chosen one."""

    key_layer = Layer.WORLDS

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface, Table(self.columns(), key=lambda one: one["name"]))
        self._worlds: list[dict[str, str]] = []
        self._known: dict[str, World] = {}
        self._scenes: dict[str, MapScene] = {}
        self._asked: set[str] = set()
        self._reached: Reached = {}
        self._starting = SecondPress(lambda: interface.station.time_s)

    def compose_content(self) -> ComposeResult:
        """Compose heading, list, preview and facts."""
        yield Lines(id="heading")
        with Horizontal(id="worlds"):
            with Vertical():
                yield ColumnHeads(self.table, id="columns")
                yield ListView(id="rows")
            yield MapWidget(ascii_only=self.interface.ascii_only, id="preview")
        yield Lines(id="about")

    def on_mount(self) -> None:
        """Query the list of worlds and the outcomes of the study."""
        self.interface.run_in_background(partial(query_worlds, "list"), self.take_list)
        self.interface.run_in_background(read_reached_counts, self.take_reached)
        super().on_mount()

    def take_list(self, found: dict[str, Any]) -> None:
        """Show the list of worlds."""
        self._worlds = found["worlds"]
        self.redraw()

    def take_reached(self, reached: Reached) -> None:
        """Show the outcomes of the study."""
        self._reached = reached
        self.redraw()

    def take_world(self, found: tuple[World, MapScene]) -> None:
        """Show facts and map of a world."""
        world, scene = found
        self._known[world.name], self._scenes[world.name] = world, scene
        self.redraw()

    def columns(self) -> Sequence[Column[Mapping[str, str]]]:
        """Return the columns of the list; the world in use has a mark."""
        return (
            Column("world", 15, lambda one: one["name"]),
            Column("now", 4, lambda one: "●" if self.is_here(one) else "", role=lambda _: "ok"),
            Column("description", 0, lambda one: one["says"]),
        )

    def is_here(self, one: Mapping[str, str]) -> bool:
        """Return whether the robot drives in this world."""
        world = self.interface.station.world
        return world is not None and world.name == one["name"]

    @property
    def chosen_world(self) -> Mapping[str, str]:
        """Name and description of the chosen world; empty when none is listed."""
        return self.chosen or {"name": "", "says": ""}

    def draw(self) -> None:
        """Draw the list and the chosen world."""
        hint = RESTARTS if self.interface.stack else NOT_OURS
        about = () if self.words or self.filtering else (faint(f"   {hint}"),)
        self.draw_rows(self._worlds, row(f" {len(self._worlds)} worlds", *about))
        self.query_chosen()
        self.draw_chosen()

    def draw_chosen(self) -> None:
        """Draw preview and facts of the chosen world."""
        name, about, preview = self.chosen_world["name"], self.lines("about"), self.preview
        preview.paint(self.app.theme)
        preview.show(self._scenes.get(name, MapScene()))
        rows = fact_rows(self._known.get(name), self.chosen_world["says"])
        rows += ends_rows(self._reached.get(name), about.size.width)
        about.styles.height = len(rows) + 1
        about.show(rows)

    @property
    def preview(self) -> MapWidget:
        """The map of the chosen world."""
        return self.query_one("#preview", MapWidget)

    def query_chosen(self) -> None:
        """Query the facts of the chosen world, once."""
        name = self.chosen_world["name"]
        if name and name not in self._asked:
            self._asked.add(name)
            self.interface.run_in_background(partial(looked_up, name), self.take_world)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        return {**super().actions(), "world-start": self.begin}

    def begin(self) -> None:
        """Read the chosen world, to start it."""
        stack, name = self.interface.stack, self.chosen_world["name"]
        if stack is None:
            self.interface.note(f"{NOT_OURS}; in another terminal: sidestep up --world {name}")
        elif name and not self._starting.is_second(name):
            key = self.interface.key_shown("world-start")
            self.interface.note(confirmation(key, f"stop this run and start {name}"))
        elif name:
            self.interface.note(f"reading world {name}")
            self.interface.run_in_background(partial(stack.scenario_in, name), self.start)

    def start(self, scenario: Scenario) -> None:
        """Restart the processes with a scenario."""
        change_world(self.interface, scenario, "restarting the processes")


def looked_up(name: str) -> tuple[World, MapScene]:
    """Return a world and its map. Raise UserError or RemoteError when it cannot be read."""
    world = world_in(query_worlds("show", name))
    return world, preview_of(shown(world, ""))


def fact_rows(world: World | None, description: str) -> list[Row]:
    """Return description, size, start, goal and faults of a world."""
    if world is None:
        return [row(faint(" reading ..."))]
    width_m, height_m = world.size_m
    start, goal, way_m = world.start, world.goal, world.shortest_path_m
    moving = sum(isinstance(one, WorldCircle) and bool(one.path_m) for one in world.obstacles)
    faults = ", ".join(str(one["kind"]) for one in world.faults) or "none"
    return [
        row(Span(f" {world.name}", "accent"), f"  {description}"),
        row(
            head(" size   "), f"{width_m:g} x {height_m:g} m, ",
            f"{len(world.obstacles)} obstacles, {moving} moving", head("  faults "), faults,
        ),
        row(
            head(" from   "), f"{start.x_m:g} {start.y_m:g} at {degrees(start.heading_rad):g}°",
            head("  to "), f"{goal.x_m:g} {goal.y_m:g}",
            "" if goal.heading_rad is None else f" at {degrees(goal.heading_rad):g}°",
            head("  shortest way "), f"{number(way_m)} m" if way_m else "none",
        ),
    ]  # fmt: skip


def ends_rows(reached: Mapping[str, int] | None, width: int) -> list[Row]:
    """Return how many runs of each navigator reached the goal in the study; no rows if unknown."""
    if not reached:
        return []
    words = ", ".join(f"{navigator} {count}" for navigator, count in reached.items())
    first, *more = wrap(f"{REACHED}{words}", max(len(REACHED), width - 9))
    return [row(head(" study  "), first), *(row(f"        {line}") for line in more)]
