"""Explore the abstract states breadth-first, check each transition, and write state diagrams.

A part is the events that are explored together. The first path to a state is a shortest one. The
document has state diagrams in Mermaid.
"""

from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final, NamedTuple

from checks.model.events import (
    ARM,
    CLEAR,
    FROM_ROBOT,
    LOOKS,
    REQUESTS,
    RESTS,
    SEIZE,
    SET_POSE,
    STOPS,
    TRANSFERS,
    VARIANTS,
    WORLD,
    EventOutcome,
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
from checks.model.model_world import (
    ADA,
    ADAS_OTHER,
    BOB,
    FAR,
    PARAMS,
    SPEED_MM_S,
    STRANGER,
    Memento,
    ModelWorld,
    capture,
    forcible,
    restore,
)
from protocol.topic import person_of
from protocol.wire.enums import Command, GoalState, MissionState, Mode, Vehicle
from protocol.wire.messages import CommandRequest, LeaseRequest
from robot.core import modes, reasons, states
from robot.core.modes import Machine
from robot.core.safety.failsafe import ROWS
from robot.mission import MissionExecutor
from runtime.units import NS_PER_MS

SENDERS: Final = {speed_mm_s: operator for operator, speed_mm_s in SPEED_MM_S.items()}
OF_GOAL: Final = ("goal_state", "goal_reason")
COMPARED: Final = tuple(name for name in Machine.__slots__ if name not in OF_GOAL)
LIVE: Final = "LIVE"
EVERYBODY: Final = (ADA, ADAS_OTHER, BOB, STRANGER)
ENDED: Final = "ENDED"
"""Goal states in which the robot drives are not distinguished."""


class Abstract(NamedTuple):
    """A state of the model; worlds with the same abstract state are considered equal."""

    vehicle: str
    mode: str
    resume_mode: str
    goal: str
    mission: str
    item: int
    leg: str
    fence: tuple[float, float] | None
    fence_lost: bool
    placed: bool
    is_far: bool
    holder: str
    is_kept: bool
    driver: str
    present: frozenset[str]
    operator: bool
    senses: bool
    cause: bool
    steering: str
    unread: str


class StateFacts(NamedTuple):
    """An abstract state with details that the invariants need."""

    abstract: Abstract
    details: tuple[Any, ...]
    goal_state: int
    goal_reason: int
    vehicle_reason: int
    mission_reason: int
    guard_stop_m: float
    allowed: tuple[str, ...]
    driver_is_there: bool


def abstract(world: ModelWorld) -> Abstract:
    """Return the abstract state, without values that the code does not read in this state."""
    vehicle = world.vehicle
    machine, mission = vehicle.state.machine, vehicle.mission
    fence, holder = machine.fence, vehicle.lease.holder
    waits = machine.mode == states.HOLD and (modes.goal_is_active(machine) or mission.active)
    return Abstract(
        vehicle=Vehicle(machine.vehicle).name,
        mode=Mode(machine.mode).name,
        resume_mode=Mode(machine.resume_mode).name if waits else "",
        goal=goal_of(machine, mission),
        mission=MissionState(mission.state).name,
        item=mission.current,
        leg=leg_of(machine, mission),
        fence=None if fence is None else (fence.xs_m[0], fence.radius_m),
        fence_lost=machine.fence_unreadable,
        placed=machine.placed,
        is_far=world.here == FAR,
        holder=STRANGER if holder is None else holder.operator,
        is_kept=holder is not None and vehicle.lease._ends_ns != vehicle.lease._idle_ns,
        driver=vehicle.commands.driver,
        present=world.present,
        operator=machine.operator,
        senses=machine.senses,
        cause=machine.cause != reasons.OK,
        steering=steered_by(world),
        unread=world.unread,
    )


def goal_of(machine: Machine, mission: MissionExecutor) -> str:
    """Return the state of the goal; its end matters only to a mission under way."""
    if modes.goal_is_active(machine):
        return LIVE
    if not (mission.active and mission._drives and machine.serial == mission._serial):
        return ""
    if machine.goal_state in (states.STUCK, states.ABORTED):
        return ENDED
    return GoalState(machine.goal_state).name


def leg_of(machine: Machine, mission: MissionExecutor) -> str:
    """Return the progress of a mission with its item; it ends when the goal was replaced."""
    if not mission.active:
        return ""
    if machine.serial != mission._serial:
        return "replaced"
    if not mission._begun:
        return "to set off"
    return "on the way" if mission._left_ms is None else "there"


def facts(world: ModelWorld) -> StateFacts:
    """Return the abstract state and the details of a world."""
    vehicle = world.vehicle
    machine, mission = vehicle.state.machine, vehicle.mission
    return StateFacts(
        abstract=abstract(world),
        details=(
            tuple([getattr(machine, name) for name in COMPARED]),
            tuple([(name, value) for name, value in vars(mission).items()]),
            vehicle.lease.holder,
            vehicle.teleop.newest(world.now_ns),
            vehicle.params,
        ),
        goal_state=machine.goal_state,
        goal_reason=machine.goal_reason,
        vehicle_reason=machine.vehicle_reason,
        mission_reason=mission.reason,
        guard_stop_m=vehicle.params.guard_stop_m,
        allowed=tuple(one for one in EVERYBODY if vehicle.lease.allows(one)),
        driver_is_there=driver_is_there(world),
    )


def driver_is_there(world: ModelWorld) -> bool:
    """Return whether the program that has the robot move sends heartbeats, if one is known."""
    driver = world.vehicle.commands.driver
    beaten_ns = world.vehicle.lease.beaten_ns(driver)
    since_ns = None if beaten_ns is None else world.now_ns - beaten_ns
    return not driver or (since_ns is not None and since_ns <= PARAMS.op_lost_ms * NS_PER_MS)


def steered_by(world: ModelWorld) -> str:
    """Return the sender of the teleop frame in force, identified by its speed."""
    teleop = world.vehicle.teleop.newest(world.now_ns)
    return STRANGER if teleop is None else SENDERS[teleop.speed_mm_s]


DRIVING_MODES: Final = ("AUTO", "GUIDED", "SMART_RTL")
NEEDS_OPERATOR: Final = ("GUIDED", "MANUAL")


class Transition(NamedTuple):
    """A transition with its event and outcome."""

    before: StateFacts
    event: ModelEvent
    outcome: EventOutcome
    after: StateFacts

    @property
    def turns(self) -> bool:
        """True if the outputs turn a wheel."""
        outputs = self.outcome.outputs
        return outputs is not None and (outputs.left_mrad_s != 0 or outputs.right_mrad_s != 0)

    @property
    def accepted(self) -> bool:
        """True for an accepted request."""
        return self.event.is_request and self.outcome.reason == reasons.OK

    @property
    def refused(self) -> bool:
        """True for a refused request."""
        return self.event.is_request and self.outcome.reason != reasons.OK

    @property
    def is_stop(self) -> bool:
        """True for a stop request."""
        return self.event.name in STOPS or self.event.name == "stop with a used number"


def wheels_turn_only_on_command(step: Transition) -> bool:
    """Check that wheels turn only while armed, driving to a goal or steered by the driver."""
    now = step.after.abstract
    if not step.turns:
        return True
    if now.vehicle != "ACTIVE":
        return False
    if now.mode in DRIVING_MODES:
        return now.goal == LIVE
    if now.steering not in step.after.allowed or now.driver not in ("", now.steering):
        return False
    return now.mode == "MANUAL" and now.steering != STRANGER


def operator_modes_need_an_operator(step: Transition) -> bool:
    """Check that GUIDED and MANUAL turn no wheel without a fresh heartbeat."""
    now = step.after.abstract
    return not step.turns or now.operator or now.mode not in NEEDS_OPERATOR


def a_drive_needs_its_program(step: Transition) -> bool:
    """Check that GUIDED and MANUAL turn no wheel without the program that began the drive."""
    needs = step.after.abstract.mode in NEEDS_OPERATOR
    return not step.turns or not needs or step.after.driver_is_there


def only_requests_change_the_mode(step: Transition) -> bool:
    """Check that only an accepted request of an operator changes the mode."""
    return step.before.abstract.mode == step.after.abstract.mode or step.accepted


def only_arming_arms(step: Transition) -> bool:
    """Check that the vehicle becomes ACTIVE only by an accepted request to arm."""
    if step.before.abstract.vehicle == "ACTIVE" or step.after.abstract.vehicle != "ACTIVE":
        return True
    return step.accepted and step.event.name == ARM


def lost_fence_prevents_arming(step: Transition) -> bool:
    """Check that a robot with an unreadable fence arms only after a new or cleared fence."""
    return not (step.after.abstract.fence_lost and step.after.abstract.vehicle == "ACTIVE")


def world_needs_a_place(step: Transition) -> bool:
    """Check that without its place a robot accepts no goal, mission or way back in the world."""
    return step.before.abstract.placed or not (step.accepted and step.event.name in WORLD)


def fence_needs_a_place(step: Transition) -> bool:
    """Check that a tick ends with no armed robot that has a fence but does not know its place."""
    now, ticked = step.after.abstract, step.outcome.outputs is not None
    return not ticked or now.placed or now.fence is None or now.vehicle != "ACTIVE"


def only_clear_ends_an_emergency_stop(step: Transition) -> bool:
    """Check that only an accepted request to clear it ends EMERGENCY_STOP, in STANDBY."""
    if step.before.abstract.vehicle != "EMERGENCY_STOP":
        return True
    vehicle = step.after.abstract.vehicle
    cleared = step.accepted and step.event.name == CLEAR and vehicle == "STANDBY"
    return vehicle == "EMERGENCY_STOP" or cleared


def stop_takes_effect_at_once(step: Transition) -> bool:
    """Check that every stop, of any sender, leads to EMERGENCY_STOP at once and is accepted."""
    stopped = step.after.abstract.vehicle == "EMERGENCY_STOP" and step.accepted
    return not step.is_stop or stopped


def failsafe_stops_at_once(step: Transition) -> bool:
    """Check that a failsafe while armed ends the tick in FAILSAFE with wheels at rest."""
    if step.event.group != "cause" or step.before.abstract.vehicle != "ACTIVE":
        return True
    return step.after.abstract.vehicle == "FAILSAFE" and not step.turns


def only_the_holder_commands(step: Transition) -> bool:
    """Check that while the lease is held exactly the programs of its person may command."""
    person = step.after.abstract.holder.partition("/")[0]
    own = tuple(one for one in EVERYBODY if one.partition("/")[0] == person)
    return not person or step.after.allowed == own


def other_operators_change_nothing(step: Transition) -> bool:
    """Check that other operators may only stop the robot, read, and seize the lease."""
    event = step.event
    if not event.is_request or event.operator in step.before.allowed:
        return True
    if step.is_stop or event.name in RESTS | LOOKS or event.name == SEIZE:
        return True
    return step.refused and step.before.details == step.after.details


def refusal_changes_nothing(step: Transition) -> bool:
    """Check that a refused request changes at most the state of a goal that was never set."""
    if not step.refused:
        return True
    goals_differ = (step.before.goal_state, step.before.goal_reason) != (
        step.after.goal_state,
        step.after.goal_reason,
    )
    unset = step.before.goal_state in (GoalState.NONE, GoalState.REFUSED)
    shown = unset and step.after.goal_state == GoalState.REFUSED
    return step.before.details == step.after.details and (shown or not goals_differ)


def every_end_has_a_reason(step: Transition) -> bool:
    """Check that STUCK, ABORTED and REFUSED goals, failed missions and failsafes have a reason."""
    now = step.after
    unexplained = (
        now.goal_state in (GoalState.STUCK, GoalState.ABORTED, GoalState.REFUSED)
        and now.goal_reason == reasons.OK
    )
    failed = now.abstract.mission == "FAILED" and now.mission_reason == reasons.OK
    tripped = now.abstract.vehicle == "FAILSAFE" and now.vehicle_reason not in FAILSAFES
    return not (unexplained or failed or tripped)


def disarmed_robot_has_no_goal(step: Transition) -> bool:
    """Check that no goal is live while the vehicle is not armed."""
    now = step.after.abstract
    return now.goal != LIVE or now.vehicle == "ACTIVE"


def disarmed_robot_has_no_mission(step: Transition) -> bool:
    """Check that a tick ends a mission whose robot is not armed."""
    ticked = step.outcome.outputs is not None
    if not ticked or step.before.abstract.vehicle == "ACTIVE":
        return True
    return step.after.abstract.mission not in ("RUNNING", "HOLDING", "PAUSED")


def safety_parameters_stay_safe(step: Transition) -> bool:
    """Check that safety parameters change only while disarmed and stay as safe as configured."""
    before, after = step.before, step.after
    changed = before.guard_stop_m != after.guard_stop_m
    armed = before.abstract.vehicle == "ACTIVE"
    return after.guard_stop_m >= PARAMS.guard_stop_m and not (changed and armed)


FAILSAFES: Final = frozenset(row.reason for row in ROWS)
INVARIANTS: Final[tuple[Callable[[Transition], bool], ...]] = (
    *(wheels_turn_only_on_command, operator_modes_need_an_operator),
    *(a_drive_needs_its_program, only_requests_change_the_mode, only_arming_arms),
    *(lost_fence_prevents_arming, world_needs_a_place, fence_needs_a_place),
    *(only_clear_ends_an_emergency_stop, stop_takes_effect_at_once, failsafe_stops_at_once),
    *(only_the_holder_commands, other_operators_change_nothing, refusal_changes_nothing),
    *(every_end_has_a_reason, disarmed_robot_has_no_goal, disarmed_robot_has_no_mission),
    safety_parameters_stay_safe,
)


def rule_of(invariant: Callable[[Transition], bool]) -> str:
    """Return the rule in words, from the docstring."""
    rule = (invariant.__doc__ or "").partition("\n")[0].removeprefix("Check that ")
    return rule[0].upper() + rule[1:]


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
