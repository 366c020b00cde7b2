"""Breadth-first search through the abstract states; the first path to a state is a shortest one."""

from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from checks.model.events import ModelEvent
from checks.model.facts import LIVE, Abstract, StateFacts, facts
from checks.model.invariants import INVARIANTS, Transition, rule_of
from checks.model.memento import Memento, capture, restore
from checks.model.world import ModelWorld, forcible


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
