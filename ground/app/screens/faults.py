"""Faults: what can be made to go wrong with processes that are ours, and in their world."""

from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

from ground.app.input.key_table import Layer
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.listed import ListScreen
from ground.app.screens.sheet import Action
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.app.worlds import ask_worlds
from ground.launch.launcher import PROCESS_FAULTS
from ground.launch.scenario import Scenario
from runtime.errors import UserError

USUAL_START_S: Final = 3.0


HOW: Final = "TARGET [VALUE] [FROM_S]"


class InjectableFault(NamedTuple):
    """`kind` of the plant, or what happens to the process of a `role`."""

    name: str
    says: str
    role: str = ""
    kind: str = ""
    targets: tuple[str, ...] = ()
    unit: str = ""


def heading_row(ours: bool) -> Row:
    if not ours:
        return row(" what can go wrong", faint("   these are not ours: sidestep up has its own"))
    return row(
        " what can go wrong",
        faint("   now: at once   anew: ends what runs, starts the world with it"),
    )


def trouble_row(one: InjectableFault, chosen: bool) -> Row:
    when = "now  " if one.role else "anew "
    name = Span(f"{one.name:<18}", "reverse" if chosen else "text")
    return row(faint(f" {when}"), name, f" {one.says}")


def about_rows(one: InjectableFault | None) -> list[Row]:
    if one is None:
        return [row(faint(" reading ..."))]
    first = row(Span(f" {one.name}", "accent"), f"  {one.says}")
    if one.role:
        return [first, row(faint(" s does it now"))]
    targets = ", ".join(one.targets) or "no target"
    return [
        first,
        row(head(" targets "), targets, head("   value in "), one.unit or "no unit"),
        row(faint(f" s asks for {HOW}; then what runs ends, and the world starts anew with it")),
    ]


class FaultsScreen(ListScreen):
    key_layer = Layer.FAULTS

    def __init__(self, deck: AppInterface) -> None:
        super().__init__(deck)
        self._kinds: list[InjectableFault] = []

    def on_mount(self) -> None:
        self.lines("about").styles.height = 4
        self.deck.aside(partial(ask_worlds, "faults"), self.take_kinds)
        super().on_mount()

    def take_kinds(self, found: dict[str, Any]) -> None:
        self._kinds = [
            InjectableFault(
                one["kind"], one["says"], kind=one["kind"], targets=tuple(one["targets"]),
                unit=one["unit"],
            )
            for one in found["faults"]
        ]  # fmt: skip
        self.look()

    def troubles(self) -> list[InjectableFault]:
        """Those of our processes first: they happen at once."""
        roles = self.deck.stack.roles() if self.deck.stack else []
        ours = [
            InjectableFault(f"{what} {role}", says, role=role)
            for role in roles
            for what, (_, says) in PROCESS_FAULTS.items()
        ]
        return [*ours, *self._kinds]

    @property
    def chosen(self) -> InjectableFault | None:
        found = self.troubles()
        return found[self.listed.at] if self.listed.at < len(found) else None

    def draw(self) -> None:
        self.lines("heading").show([heading_row(self.deck.stack is not None)])
        self.listed.window(self.troubles(), trouble_row)
        self.lines("about").show(about_rows(self.chosen))

    def actions(self) -> Mapping[str, Action]:
        return {**super().actions(), "fault-begin": self.let}

    def let(self) -> None:
        one = self.chosen
        if one is None:
            return
        if self.deck.stack is None:
            self.deck.say("put it into a world file, and start that: sidestep up --world FILE")
        elif one.role:
            self.deck.say(self.deck.stack.inject_fault(one.role, one.name.split()[0]))
        else:
            self.ask(f"{one.kind} {HOW}", f"{one.targets[0]} ".lstrip(), partial(self.begin, one))

    def begin(self, one: InjectableFault, words: str) -> None:
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


def fault_of(one: InjectableFault, words: list[str]) -> dict[str, object]:
    """The table of a world file; UserError names what is wrong."""
    target = words.pop(0) if one.targets != ("",) and words else ""
    if target not in one.targets:
        raise UserError(f"{target!r} is none of {', '.join(one.targets)}")
    try:
        value, start_s = [*map(float, words), *(0.0, USUAL_START_S)[len(words) :]]
    except ValueError:
        raise UserError(f"write {HOW}, in numbers") from None
    return {"kind": one.kind, "target": target, "value": value, "start_s": start_s}
