"""Explore the abstract states breadth-first, part by part, and write them as state diagrams.

A part is the events that are explored together. The first path to a state is a shortest one. The
document has state diagrams in Mermaid.
"""

from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from checks.model.events import (
    ARM,
    CLEAR,
    FROM_ROBOT,
    REQUESTS,
    SEIZE,
    SET_POSE,
    STOPS,
    TRANSFERS,
    VARIANTS,
    WORLD,
    ModelEvent,
    displacement,
    ends_of_goals,
    every_request,
    failsafe_causes,
    lost_fence,
    lost_place,
    presence,
    requests,
    steering,
    stop_with_used_id,
    ticks,
    transfers,
    while_held,
)
from checks.model.invariants import (
    INVARIANTS,
    LIVE,
    Abstract,
    StateFacts,
    Transition,
    facts,
    rule_of,
)
from checks.model.model_world import (
    ADA,
    ADAS_OTHER,
    BOB,
    STRANGER,
    Memento,
    ModelWorld,
    capture,
    forcible,
    restore,
)
from protocol.topic import person_of
from protocol.wire.enums import Command, MissionState, Mode, Vehicle
from protocol.wire.messages import CommandRequest, LeaseRequest
from robot.core import reasons


class ModelPart(NamedTuple):
    """A part of the model, small enough to be explored as a whole."""

    name: str
    events: tuple[ModelEvent, ...]


MODES: Final = (
    *(name for name, *_ in VARIANTS[Command.COMPONENT_ARM_DISARM]),
    *(name for name, *_ in VARIANTS[Command.DO_SET_MODE]),
    *(name for name, *_ in VARIANTS[Command.DO_PAUSE_CONTINUE]),
    *STOPS,
    "abort",
    CLEAR,
    "goto in AUTO",
    "goto in GUIDED",
)
BASE: Final = (ARM, "disarm", "mode HOLD", "stop", "abort", CLEAR, "goto in AUTO")
SHARED: Final = (
    "take",
    "leave",
    ARM,
    "mode MANUAL",
    "goto in GUIDED",
    "pause",
    "continue",
    "abort",
)
LEASE: Final = (*REQUESTS[LeaseRequest], ARM, "mode MANUAL", "mode HOLD", "stop", CLEAR)


def parts() -> tuple[ModelPart, ...]:
    """Return the parts of the model; each includes the states that they share."""
    return (*parts_of_driving(), *parts_of_the_lease())


def parts_of_driving() -> tuple[ModelPart, ...]:
    """Return the parts about modes, missions, fence and settings."""
    missions = (*BASE, "mode AUTO", "mode GUIDED", "mode MANUAL", "pause", "continue")
    about_missions = [name for name in REQUESTS[CommandRequest] if "mission" in name]
    of_mission = (*about_missions, "jump to item 2", "jump to no item", "clear mission")
    lease = {*REQUESTS[LeaseRequest]}
    return (
        part(
            "modes",
            requests(ADA, {*MODES, "return", "goto in MANUAL", "goto too far", "command unknown"}),
            stop_with_used_id(ADA),
            requests(STRANGER, STOPS),
            presence(ADA),
            steering(ADA),
            ticks(),
            ends_of_goals(),
            failsafe_causes(),
        ),
        part(
            "missions",
            requests(ADA, {*missions, *of_mission, "goto in GUIDED"}),
            transfers(ADA, ("upload mission",)),
            presence(ADA),
            ticks(),
            ends_of_goals(),
            failsafe_causes(reasons.BUMPER),
        ),
        part_of_the_place(),
        part(
            "fence and settings",
            requests(ADA, {*BASE, "return"} | every_request() - {*MODES, *of_mission, *lease}),
            transfers(ADA, TRANSFERS),
            lost_fence(),
            displacement(),
            ticks(),
            ends_of_goals(),
        ),
    )


def part_of_the_place() -> ModelPart:
    """Return the part about a robot that loses its place and gets a pose."""
    return part(
        "place",
        requests(ADA, {*BASE, *WORLD, FROM_ROBOT, SET_POSE, "set pose nowhere", "clear fence"}),
        transfers(ADA, ("upload mission", "put fence around all")),
        lost_place(),
        ticks(),
        ends_of_goals(),
    )


def parts_of_the_lease() -> tuple[ModelPart, ...]:
    """Return the parts about the lease."""
    return (
        part(
            "lease",
            *(requests(one, LEASE) for one in (ADA, BOB, STRANGER)),
            *(presence(one) for one in (ADA, BOB)),
            *(steering(one, at_once=False) for one in (ADA, BOB)),
            ticks(),
        ),
        part(
            "two programs of a person",
            *(requests(one, SHARED) for one in (ADA, ADAS_OTHER)),
            requests(BOB, {SEIZE}),
            *(presence(one) for one in (ADA, ADAS_OTHER)),
            *(steering(one) for one in (ADA, ADAS_OTHER)),
            ticks(),
            ends_of_goals(),
        ),
        part(
            "requests without the lease",
            requests(ADA, {*BASE, "take", "upload mission"}),
            transfers(ADA, ("upload mission",)),
            presence(ADA),
            *(while_held(requests(one, every_request())) for one in (BOB, STRANGER)),
            *(while_held(transfers(one, TRANSFERS)) for one in (BOB, STRANGER)),
            ticks(),
        ),
    )


def part(name: str, *events: Iterable[ModelEvent]) -> ModelPart:
    """Return a part with all these events."""
    return ModelPart(name, tuple(event for some in events for event in some))


class Edge(NamedTuple):
    """A transition from one abstract state to another."""

    before: Abstract
    event: ModelEvent
    after: Abstract
    accepted: bool


class RuleViolation(NamedTuple):
    """A violated rule, with the shortest list of events that leads to it."""

    rule: str
    events: tuple[str, ...]
    before: Abstract
    after: Abstract

    def __str__(self) -> str:
        steps = "\n".join(f"  {k}. {name}" for k, name in enumerate(self.events, 1))
        changes = ", ".join(
            f"{name} {old} -> {new}"
            for name, old, new in zip(Abstract._fields, self.before, self.after, strict=True)
            if old != new
        )
        return f"{self.rule}\n{steps}\n  last step: {changes or 'no change'}"


class Exploration(NamedTuple):
    """All abstract states with a shortest path to each, and all transitions between them.

    `violations` has a shortest counterexample for each pair of a rule and an event.
    """

    states: dict[Abstract, tuple[str, ...]]
    edges: list[Edge]
    violations: dict[tuple[str, str], RuleViolation]


def explore(events: Sequence[ModelEvent], *, until: str = "") -> Exploration:
    """Visit every abstract state that these events can reach from the start of a robot.

    With `until`, end as soon as this rule is violated.
    """
    world = ModelWorld()
    found = Exploration({}, [], {})
    with forcible(world):
        first = facts(world)
        found.states[first.abstract] = ()
        pending = deque([(first, capture(world))])
        while pending and not any(rule == until for rule, _ in found.violations):
            before, memento = pending.popleft()
            pending.extend(successors(world, events, found, before, memento))
    return found


def successors(
    world: ModelWorld,
    events: Sequence[ModelEvent],
    found: Exploration,
    before: StateFacts,
    memento: Memento,
) -> Iterator[tuple[StateFacts, Memento]]:
    """Apply every event in one state, and yield the states that are new."""
    restore(memento, perception=True)
    for event in events:
        if not event.enabled(world):
            continue
        step = Transition(before, event, event.act(world), facts(world))
        if record(found, step):
            yield step.after, capture(world)
        restore(memento, perception=not event.keeps_perception)


def record(found: Exploration, step: Transition) -> bool:
    """Keep a transition and check it; return whether it led to a new state."""
    before, after = step.before.abstract, step.after.abstract
    found.edges.append(Edge(before, step.event, after, not step.refused))
    for invariant in INVARIANTS:
        if not invariant(step):
            rule = rule_of(invariant)
            path = (*found.states[before], step.event.by)
            case = (rule, step.event.name)
            found.violations.setdefault(case, RuleViolation(rule, path, before, after))
    if after in found.states:
        return False
    found.states[after] = (*found.states[before], step.event.by)
    return True


def endless(found: Exploration) -> list[Abstract]:
    """Return the states with a live goal from which no end of it can be reached.

    Failsafes and operators that leave do not count as an end.
    """
    sources: dict[Abstract, list[Abstract]] = defaultdict(list)
    for edge in found.edges:
        if edge.event.group in ("request", "pursuit"):
            sources[edge.after].append(edge.before)
    pending = [state for state in found.states if state.goal != LIVE]
    ending = set(pending)
    while pending:
        for state in sources[pending.pop()]:
            if state not in ending:
                ending.add(state)
                pending.append(state)
    return [state for state in found.states if state not in ending]


HOLDERS: Final = {STRANGER: "FREE", "ada": "HELD_BY_ADA", "bob": "HELD_BY_BOB"}


class StateDiagram(NamedTuple):
    """A diagram of one aspect of the states; `order` lists the nodes, the initial one first."""

    title: str
    node: Callable[[Abstract], str | None]
    order: tuple[str, ...]


def vehicle(state: Abstract) -> str:
    """Return the state of the vehicle."""
    return state.vehicle


def mode_if_armed(state: Abstract) -> str | None:
    """Return the mode of an armed robot."""
    return state.mode if state.vehicle == "ACTIVE" else None


def mode_if_not_armed(state: Abstract) -> str | None:
    """Return the mode of a robot that is not armed."""
    return None if state.vehicle == "ACTIVE" else state.mode


def mission(state: Abstract) -> str:
    """Return the state of the mission."""
    return state.mission


def holder(state: Abstract) -> str:
    """Return the holder of the lease."""
    return HOLDERS[person_of(state.holder)]


VEHICLES: Final = tuple(vehicle.name for vehicle in Vehicle)
DRAWN_MODES: Final = ("HOLD", *(mode.name for mode in Mode if mode != Mode.HOLD))
MISSIONS: Final = tuple(state.name for state in MissionState)
DRAWINGS: Final = {
    "modes": (
        StateDiagram("Vehicle", vehicle, VEHICLES),
        StateDiagram("Mode while the vehicle is ACTIVE", mode_if_armed, DRAWN_MODES),
        StateDiagram("Mode while the vehicle is not ACTIVE", mode_if_not_armed, DRAWN_MODES),
    ),
    "missions": (StateDiagram("Mission", mission, MISSIONS),),
    "lease": (StateDiagram("Lease", holder, tuple(HOLDERS.values())),),
}
"""The diagrams of each part of the model."""

HEADER: Final = """\
# State diagrams of the robot

<!-- Generated by `make generate-docs` from the code of the robot. -->

The diagrams are drawn from an exhaustive exploration of the robot's code: every abstract state
that the commands, requests, operators and failsafes of the model can reach, visited by
breadth-first search. `checks/model` explains what the model contains.

An edge is labelled with its requests; `failsafe` means any row of the failsafe table,
`control period` means a change without a request. A request that is refused changes nothing and
is not drawn, nor is an event that leaves the state as it is.

Each transition was checked against these rules:

"""


def document(explored: Iterable[tuple[ModelPart, Exploration]]) -> str:
    """Return the whole document."""
    rules = "\n".join(f"- {rule_of(rule)}" for rule in INVARIANTS)
    sections = "\n".join(filter(None, (section(part, found) for part, found in explored)))
    return f"{HEADER}{rules}\n\n{sections}"


def section(part: ModelPart, found: Exploration) -> str:
    """Return the text of one part, with its diagrams."""
    lines = []
    for drawing in DRAWINGS.get(part.name, ()):
        lines += [f"## {drawing.title}", "", *mermaid(drawing, found.edges), ""]
    return "\n".join(lines)


def mermaid(drawing: StateDiagram, edges: Iterable[Edge]) -> list[str]:
    """Return the lines of a diagram."""
    labels: dict[tuple[str, str], set[str]] = defaultdict(set)
    for edge in edges:
        before, after = drawing.node(edge.before), drawing.node(edge.after)
        if before is not None and after is not None and before != after:
            labels[before, after].add(label(edge, drawing))
    order = drawing.order
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {order[0]}"]
    for before, after in sorted(labels, key=lambda pair: [order.index(name) for name in pair]):
        lines.append(f"    {before} --> {after}: {', '.join(sorted(labels[before, after]))}")
    return [*lines, "```"]


def label(edge: Edge, drawing: StateDiagram) -> str:
    """Return the name of an event as the diagrams show it."""
    event = edge.event
    if event.name in STOPS or event.name == "stop with a used number":
        return "stop"
    if event.is_request:
        return event.name
    if drawing.node is holder:
        return "3 s without a heartbeat or 30 s at rest"
    tripped = edge.after.vehicle == "FAILSAFE" and edge.before.vehicle == "ACTIVE"
    return "failsafe" if tripped and drawing.node is vehicle else "control period"
