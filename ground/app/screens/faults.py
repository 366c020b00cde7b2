"""Show the Faults screen: inject faults into our processes and their world."""

from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

from ground.app.app_interface import AppInterface
from ground.app.input.key_queue import SecondPress, confirmation
from ground.app.input.keymap import Layer
from ground.app.lists.table import Column, Table
from ground.app.screens.app_screen import Action
from ground.app.screens.list_screen import ListScreen
from ground.app.screens.worlds import change_world, query_worlds
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.console.completion import Assistance, Candidate
from ground.launch.launcher import PROCESS_FAULTS
from ground.launch.scenario import Scenario
from runtime.errors import UserError

DEFAULT_START_S: Final = 3.0

HOW: Final = "TARGET [VALUE] [FROM_S]"
NOT_OURS: Final = (
    "this app did not start the processes; put the fault into a world file and start that:"
    " sidestep up --world FILE"
)


class InjectableFault(NamedTuple):
    """A fault of the plant with a `kind`, or a fault of the process with a `role`."""

    name: str
    description: str
    role: str = ""
    kind: str = ""
    targets: tuple[str, ...] = ()
    unit: str = ""


def heading_row(*, ours: bool, is_short: bool) -> Row:
    """Return the heading; a short one leaves room for the filter."""
    if is_short:
        return row(" faults")
    if not ours:
        return row(" faults", faint("   not available: this app did not start the processes"))
    return row(
        " faults", faint("   now: into the running system   restart: restarts the world with it")
    )


COLUMNS: Final = (
    Column[InjectableFault]("fault", 18, lambda one: one.name),
    Column[InjectableFault](
        "when", 8, lambda one: "now" if one.role else "restart", role=lambda _: "faint"
    ),
    Column[InjectableFault]("unit", 6, lambda one: one.unit, role=lambda _: "head"),
    Column[InjectableFault]("effect", 0, lambda one: one.description),
)


def about_rows(one: InjectableFault | None) -> list[Row]:
    """Return the details of a fault."""
    if one is None:
        return [row(faint(" reading ..."))]
    first = row(Span(f" {one.name}", "accent"), f"  {one.description}")
    if one.role:
        return [first, row(faint(" s, pressed twice, injects it now"))]
    targets = ", ".join(one.targets) or "no target"
    value = (head("   value in "), Span(one.unit)) if one.unit else ()
    return [
        first,
        row(head(" targets "), targets, *value),
        row(faint(f" s asks for {HOW} and restarts the world with the fault")),
    ]


class FaultsScreen(ListScreen[InjectableFault]):
    """The list of faults."""

    key_layer = Layer.FAULTS

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface, Table(COLUMNS, key=lambda one: one.name))
        self._kinds: list[InjectableFault] = []
        self._injecting = SecondPress(lambda: interface.station.time_s)

    def on_mount(self) -> None:
        """Query the faults of the plant."""
        self.lines("about").styles.height = 4
        self.interface.run_in_background(partial(query_worlds, "faults"), self.take_kinds)
        super().on_mount()

    def take_kinds(self, found: dict[str, Any]) -> None:
        """Show the faults of the plant."""
        self._kinds = [
            InjectableFault(
                one["kind"], one["says"], kind=one["kind"], targets=tuple(one["targets"]),
                unit=one["unit"],
            )
            for one in found["faults"]
        ]  # fmt: skip
        self.redraw()

    def faults(self) -> list[InjectableFault]:
        """Return all faults; those of processes, which happen at once, come first."""
        roles = self.interface.stack.roles() if self.interface.stack else []
        ours = [
            InjectableFault(f"{what} {role}", effect, role=role)
            for role in roles
            for what, (_, effect) in PROCESS_FAULTS.items()
        ]
        return [*ours, *self._kinds]

    def draw(self) -> None:
        """Draw the list and the details of the chosen fault."""
        ours, is_short = self.interface.stack is not None, bool(self.words or self.filtering)
        self.draw_rows(self.faults(), heading_row(ours=ours, is_short=is_short))
        self.lines("about").show(about_rows(self.chosen))

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        return {**super().actions(), "fault-begin": self.inject}

    def inject(self) -> None:
        """Inject the chosen fault at the second press, or let the operator type its details."""
        one = self.chosen
        if one is None:
            return
        if self.interface.stack is None:
            self.interface.note(NOT_OURS)
        elif one.role and not self._injecting.is_second(one.name):
            key = self.interface.key_shown("fault-begin")
            self.interface.note(confirmation(key, one.name))
        elif one.role:
            self.interface.note(self.interface.stack.inject_fault(one.role, one.name.split()[0]))
        else:
            self.ask(one.kind, one.targets[0], partial(self.begin, one), partial(assisted, one))

    def begin(self, one: InjectableFault, words: str) -> None:
        """Read the same world with this fault, to start it."""
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
        """Restart the processes with a scenario."""
        change_world(self.interface, scenario, "restarting with the fault")


def assisted(one: InjectableFault, text: str) -> Assistance:
    """Return the targets that fit, and the values that may follow."""
    words = text.split(" ")
    if len(words) == 1 and one.targets != ("",):
        fitting = [target for target in one.targets if target.startswith(text) and target != text]
        return Assistance(tuple(Candidate(target, target) for target in fitting))
    given = len(words) - (one.targets != ("",))
    value = f"[VALUE {one.unit}]" if one.unit else "[VALUE]"
    return Assistance(hint=" ".join([value, "[FROM_S]"][max(0, given - 1) :]))


def fault_of(one: InjectableFault, words: list[str]) -> dict[str, object]:
    """Return a fault as in a world file. Raise UserError when the words are wrong."""
    target = words.pop(0) if one.targets != ("",) and words else ""
    if target not in one.targets:
        raise UserError(f"unknown target {target!r}; known: {', '.join(one.targets)}")
    try:
        value, start_s = [*map(float, words), *(0.0, DEFAULT_START_S)[len(words) :]]
    except ValueError:
        raise UserError(f"write {HOW}: VALUE and FROM_S are numbers") from None
    return {"kind": one.kind, "target": target, "value": value, "start_s": start_s}
