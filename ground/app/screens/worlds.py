"""Worlds: those that come with the program; when the processes are ours, another one is started."""

import json
from collections.abc import Mapping
from functools import partial
from textwrap import wrap
from typing import Any, Final

from textual.app import ComposeResult
from textual.containers import Horizontal

from ground.app.input.key_table import Layer
from ground.app.panels.aged import number
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.listed import ListScreen
from ground.app.screens.sheet import Action
from ground.app.widgets.lines import Lines
from ground.app.widgets.map import MapWidget
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.app.widgets.table import Table
from ground.app.worlds import Reached, ask_worlds, reached_in
from ground.launch.scenario import Scenario
from ground.map import Scene
from ground.station.scene import preview_of
from ground.station.world import world_in

REACHED: Final = "reached of 10 seeds: "


class WorldsScreen(ListScreen):
    key_layer = Layer.WORLDS

    def __init__(self, deck: AppInterface) -> None:
        super().__init__(deck)
        self._worlds: list[dict[str, str]] = []
        self._facts: dict[str, Mapping[str, Any]] = {}
        self._scenes: dict[str, Scene] = {}
        self._asked: set[str] = set()
        self._reached: Reached = {}

    def middle(self) -> ComposeResult:
        yield Lines(id="heading")
        with Horizontal(id="worlds"):
            yield Table(id="rows")
            yield MapWidget(ascii_only=self.deck.ascii_only, id="preview")
        yield Lines(id="about")

    def on_mount(self) -> None:
        self.deck.aside(partial(ask_worlds, "list"), self.take_list)
        self.deck.aside(reached_in, self.take_reached)
        super().on_mount()

    def take_list(self, found: dict[str, Any]) -> None:
        self._worlds = found["worlds"]
        self.look()

    def take_reached(self, reached: Reached) -> None:
        self._reached = reached
        self.look()

    def take_world(self, found: tuple[dict[str, Any], Scene]) -> None:
        facts, scene = found
        self._facts[facts["name"]], self._scenes[facts["name"]] = facts, scene
        self.look()

    @property
    def chosen(self) -> dict[str, str]:
        """Its name and what it is, both empty while no world is known."""
        return self._worlds[self.listed.at] if self._worlds else {"name": "", "says": ""}

    def draw(self) -> None:
        world = self.deck.station.world
        here = "" if world is None else world.name
        own = "s ends what runs and starts one" if self.deck.stack else "these are not ours to end"
        self.lines("heading").show([row(f" {len(self._worlds)} worlds", faint(f"   {own}"))])
        self.listed.window(self._worlds, lambda one, chosen: world_row(one, here, chosen))
        self.inquire()
        self.draw_chosen()

    def draw_chosen(self) -> None:
        name, about, preview = self.chosen["name"], self.lines("about"), self.preview
        preview.paint(self.app.theme)
        preview.show(self._scenes.get(name, Scene()))
        rows = fact_rows(self._facts.get(name), self.chosen["says"])
        rows += ends_rows(self._reached.get(name), about.size.width)
        about.styles.height = len(rows) + 1
        about.show(rows)

    @property
    def preview(self) -> MapWidget:
        return self.query_one("#preview", MapWidget)

    def inquire(self) -> None:
        """The facts of the chosen one, once."""
        name = self.chosen["name"]
        if name and name not in self._asked:
            self._asked.add(name)
            self.deck.aside(partial(looked_up, name), self.take_world)

    def actions(self) -> Mapping[str, Action]:
        return {**super().actions(), "world-start": self.begin}

    def begin(self) -> None:
        stack, name = self.deck.stack, self.chosen["name"]
        if stack is None:
            self.deck.say(f"not ours to end; in another terminal: sidestep up --world {name}")
        elif name:
            self.deck.say(f"{name}: being read")
            self.deck.aside(partial(stack.scenario_in, name), self.start)

    def start(self, scenario: Scenario) -> None:
        stack = self.deck.stack
        if stack is not None:
            self.deck.say(f"{scenario.name}: the processes are started anew")
            stack.restarted(scenario)


def looked_up(name: str) -> tuple[dict[str, Any], Scene]:
    """The facts of a world, and how it looks; UserError or RemoteError when it cannot be read."""
    facts = ask_worlds("show", name)
    return facts, preview_of(world_in(json.dumps(facts)))


def world_row(world: Mapping[str, str], here: str, chosen: bool) -> Row:
    """The one that is in force has a mark."""
    mark = Span("● " if world["name"] == here else "  ", "ok")
    name = Span(f"{world['name']:<15}", "reverse" if chosen else "text")
    return row(" ", mark, name, f" {world['says']}")


def fact_rows(facts: Mapping[str, Any] | None, says: str) -> list[Row]:
    """What it is, how large, from where to where, and what goes wrong in it."""
    if facts is None:
        return [row(faint(" reading ..."))]
    width_m, height_m = facts["size_m"]
    start, goal = facts["start"], facts["goal"]
    moving = sum("path_m" in one for one in facts["obstacles"])
    faults = ", ".join(str(one["kind"]) for one in facts["faults"]) or "none"
    way_m = facts.get("shortest_path_m")
    heading_deg = goal.get("heading_deg")
    return [
        row(Span(f" {facts['name']}", "accent"), f"  {says}"),
        row(
            head(" size   "), f"{width_m:g} x {height_m:g} m, ",
            f"{len(facts['obstacles'])} obstacles, {moving} moving", head("  faults "), faults,
        ),
        row(
            head(" from   "), f"{start['x_m']:g} {start['y_m']:g} at {start['heading_deg']:g}°",
            head("  to "), f"{goal['x_m']:g} {goal['y_m']:g}",
            "" if heading_deg is None else f" at {heading_deg:g}°",
            head("  shortest way "), f"{number(way_m)} m" if way_m else "none",
        ),
    ]  # fmt: skip


def ends_rows(reached: Mapping[str, int] | None, width: int) -> list[Row]:
    """How runs of each navigator in this world have ended; nothing when that is not known."""
    if not reached:
        return []
    words = ", ".join(f"{navigator} {count}" for navigator, count in reached.items())
    first, *more = wrap(f"{REACHED}{words}", max(len(REACHED), width - 9))
    return [row(head(" study  "), first), *(row(f"        {line}") for line in more)]
