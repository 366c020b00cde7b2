"""Worlds: those that come with the program; when the processes are ours, another one is started."""

import os
from collections.abc import Mapping
from functools import partial
from typing import Any

from ground.app.deck import Deck
from ground.app.faces.worlds import fact_rows, world_row
from ground.app.keys import Layer
from ground.app.screens.listing import Listing
from ground.app.screens.sheet import Action
from ground.leash import command
from ground.scenario import Scenario, world_facts
from ground.widgets.rows import faint, row

FACT_ROWS = 3


class WorldsScreen(Listing):
    key_layer = Layer.WORLDS

    def __init__(self, deck: Deck) -> None:
        super().__init__(deck)
        self._worlds: list[dict[str, str]] = []
        self._facts: dict[str, Mapping[str, Any]] = {}
        self._asked: set[str] = set()

    def on_mount(self) -> None:
        self.lines("about").styles.height = FACT_ROWS + 1
        self.deck.aside(partial(ask_worlds, "list"), self.take_list)
        super().on_mount()

    def take_list(self, found: dict[str, Any]) -> None:
        self._worlds = found["worlds"]
        self.look()

    def take_facts(self, found: dict[str, Any]) -> None:
        self._facts[found["name"]] = found
        self.look()

    @property
    def chosen(self) -> str:
        return self._worlds[self.listed.at]["name"] if self._worlds else ""

    def draw(self) -> None:
        world = self.deck.station.world
        here = "" if world is None else world.name
        own = "Enter starts another one" if self.deck.stack else "these processes are not ours"
        self.lines("heading").show([row(f" {len(self._worlds)} worlds", faint(f"   {own}"))])
        self.listed.window(self._worlds, lambda one, chosen: world_row(one, here, chosen))
        self.inquire()
        self.lines("about").show(fact_rows(self._facts.get(self.chosen)))

    def inquire(self) -> None:
        """The facts of the chosen one, once."""
        name = self.chosen
        if name and name not in self._asked:
            self._asked.add(name)
            self.deck.aside(partial(ask_worlds, "show", name), self.take_facts)

    def actions(self) -> Mapping[str, Action]:
        return {**super().actions(), "world-start": self.choose}

    def choose(self) -> None:
        stack, name = self.deck.stack, self.chosen
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


def ask_worlds(*words: str) -> dict[str, Any]:
    """What `sidestep worlds` says about worlds, which are the plant's."""
    return world_facts(command(["worlds", *words, "--json"], os.getpid()))
