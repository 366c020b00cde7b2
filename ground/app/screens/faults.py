"""Faults: what can be made to go wrong with processes that are ours, and in their world."""

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

from ground.app.deck import Deck
from ground.app.keys import Layer
from ground.app.screens.listing import Listing
from ground.app.screens.sheet import Action
from ground.app.screens.worlds import ask_worlds
from ground.scenario import Scenario
from ground.stack import TROUBLES
from ground.widgets.rows import Row, Span, faint, head, row
from protocol.errors import UserError

HOW = "TARGET [VALUE] [FROM_S]"
USUAL_START_S = 3.0


class Trouble(NamedTuple):
    """`kind` of the plant, or what happens to the process of a `role`."""

    name: str
    says: str
    role: str = ""
    kind: str = ""
    targets: tuple[str, ...] = ()
    unit: str = ""


class FaultsScreen(Listing):
    key_layer = Layer.WORLDS

    def __init__(self, deck: Deck) -> None:
        super().__init__(deck)
        self._kinds: list[Trouble] = []

    def on_mount(self) -> None:
        self.lines("about").styles.height = 4
        self.deck.aside(partial(ask_worlds, "faults"), self.take_kinds)
        super().on_mount()

    def take_kinds(self, found: dict[str, Any]) -> None:
        self._kinds = [
            Trouble(
                one["kind"], one["says"], kind=one["kind"], targets=tuple(one["targets"]),
                unit=one["unit"],
            )
            for one in found["faults"]
        ]  # fmt: skip
        self.look()

    def troubles(self) -> list[Trouble]:
        """Those of our processes first: they happen at once."""
        roles = self.deck.stack.roles() if self.deck.stack else []
        ours = [
            Trouble(f"{what} {role}", says, role=role)
            for role in roles
            for what, (_, says) in TROUBLES.items()
        ]
        return [*ours, *self._kinds]

    @property
    def chosen(self) -> Trouble | None:
        found = self.troubles()
        return found[self.listed.at] if self.listed.at < len(found) else None

    def draw(self) -> None:
        own = "" if self.deck.stack else "these processes are not ours: start them with sidestep up"
        self.lines("heading").show([row(" what can go wrong", faint(f"   {own}"))])
        self.listed.window(self.troubles(), trouble_row)
        self.lines("about").show(about_rows(self.chosen))

    def actions(self) -> Mapping[str, Action]:
        return {**super().actions(), "world-start": self.choose}

    def choose(self) -> None:
        one = self.chosen
        if one is None:
            return
        if self.deck.stack is None:
            self.deck.say("put it into a world file, and start that: sidestep up --world FILE")
        elif one.role:
            self.deck.say(self.deck.stack.trouble(one.role, one.name.split()[0]))
        else:
            self.ask(f"{one.kind} {HOW}", f"{one.targets[0]} ".lstrip(), partial(self.begin, one))

    def begin(self, one: Trouble, words: str) -> None:
        """The same world with this fault in it, started anew."""
        stack = self.deck.stack
        if stack is None:
            return
        try:
            fault = fault_of(one, words.split())
        except UserError as error:
            self.deck.say(f"{one.kind}: {error}")
            return
        self.deck.aside(partial(stack.scenario_in, stack.scenario.world, [fault]), self.start)

    def start(self, scenario: Scenario) -> None:
        if self.deck.stack is not None:
            self.deck.say(f"{scenario.name}: started anew with the fault")
            self.deck.stack.restarted(scenario)


def fault_of(one: Trouble, words: list[str]) -> dict[str, object]:
    """The table of a world file; UserError names what is wrong."""
    target = words.pop(0) if one.targets != ("",) and words else ""
    if target not in one.targets:
        raise UserError(f"{target!r} is none of {', '.join(one.targets)}")
    try:
        value, start_s = [*map(float, words), *(0.0, USUAL_START_S)[len(words) :]]
    except ValueError:
        raise UserError(f"write {HOW}, in numbers") from None
    return {"kind": one.kind, "target": target, "value": value, "start_s": start_s}


def trouble_row(one: Trouble, chosen: bool) -> Row:
    when = "now  " if one.role else "anew "
    return row(
        faint(f" {when}"), Span(f"{one.name:<18}", "reverse" if chosen else "text"), one.says
    )


def about_rows(one: Trouble | None) -> list[Row]:
    if one is None:
        return [row(faint(" reading ..."))]
    first = row(Span(f" {one.name}", "accent"), f"  {one.says}")
    if one.role:
        return [first, row(faint(" Enter does it now"))]
    targets = ", ".join(one.targets) or "no target"
    return [
        first,
        row(head(" targets "), targets, head("   value in "), one.unit or "no unit"),
        row(faint(f" Enter asks for {HOW} and starts the world anew with it")),
    ]
