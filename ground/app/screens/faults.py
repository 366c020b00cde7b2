"""Faults: what can be made to go wrong with processes that are ours, and in their world."""

from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

from ground.app.input.key_table import Layer
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.app_screen import Action
from ground.app.screens.list_screen import ListScreen
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.app.worlds import query_worlds
from ground.launch.launcher import PROCESS_FAULTS
from ground.launch.scenario import Scenario
from runtime.errors import UserError

USUAL_START_S: Final = 3.0


HOW: Final = "TARGET [VALUE] [FROM_S]"
NOT_OURS: Final = (
    "this app did not start the processes; put the fault into a world file and start that:"
    " sidestep up --world FILE"
)


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

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self._kinds: list[InjectableFault] = []

    def on_mount(self) -> None:
        self.lines("about").styles.height = 4
        self.interface.run_in_background(partial(query_worlds, "faults"), self.take_kinds)
        super().on_mount()

    def take_kinds(self, found: dict[str, Any]) -> None:
        self._kinds = [
            InjectableFault(
                one["kind"], one["says"], kind=one["kind"], targets=tuple(one["targets"]),
                unit=one["unit"],
            )
            for one in found["faults"]
        ]  # fmt: skip
        self.redraw()

    def troubles(self) -> list[InjectableFault]:
        """Those of our processes first: they happen at once."""
        roles = self.interface.stack.roles() if self.interface.stack else []
        ours = [
            InjectableFault(f"{what} {role}", says, role=role)
            for role in roles
            for what, (_, says) in PROCESS_FAULTS.items()
        ]
        return [*ours, *self._kinds]

    @property
    def chosen(self) -> InjectableFault | None:
        found = self.troubles()
        return found[self.list_view.at] if self.list_view.at < len(found) else None

    def draw(self) -> None:
        self.lines("heading").show([heading_row(self.interface.stack is not None)])
        self.list_view.window(self.troubles(), trouble_row)
        self.lines("about").show(about_rows(self.chosen))

    def actions(self) -> Mapping[str, Action]:
        return {**super().actions(), "fault-begin": self.let}

    def let(self) -> None:
        one = self.chosen
        if one is None:
            return
        if self.interface.stack is None:
            self.interface.note(NOT_OURS)
        elif one.role:
            self.interface.note(self.interface.stack.inject_fault(one.role, one.name.split()[0]))
        else:
            self.ask(f"{one.kind} {HOW}", f"{one.targets[0]} ".lstrip(), partial(self.begin, one))

    def begin(self, one: InjectableFault, words: str) -> None:
        """The same world with this fault in it, started anew."""
        stack = self.interface.stack
        if stack is None:
            return
        try:
            fault = fault_of(one, words.split())
        except UserError as error:
            self.interface.note(f"{one.kind}: {error}")
            return
        self.interface.run_in_background(
            partial(stack.scenario_in, stack.scenario.world, [fault]), self.start
        )

    def start(self, scenario: Scenario) -> None:
        if self.interface.stack is not None:
            self.interface.note(f"{scenario.name}: started anew with the fault")
            self.interface.stack.restarted(scenario)


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
