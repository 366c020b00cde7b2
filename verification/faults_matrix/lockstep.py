"""One repetition in simulated time: the whole stack in this process, over real sockets.

What is random (when the fault comes, in which phase of a period, what noise there is) comes of the
number of the repetition. A router that dies, and whatever is cut off, is made by the bus's own
trouble: nothing passes. Processes that hang do not get their turn.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from random import Random
from typing import Final

from plant.model.types import World
from plant.world.file import load
from protocol.bus.faults.link_faults import LinkFaults
from protocol.topics import Role
from protocol.wire.enums import Command
from protocol.wire.enums import Vehicle as VehicleState
from runtime.clock import Tick
from runtime.units import NS_PER_S
from verification.faults_matrix import power_cuts
from verification.faults_matrix.actions import (
    Act,
    Break,
    Cut,
    Deafen,
    Delay,
    Disturb,
    Double,
    EmergencyStop,
    Exaggerate,
    Hang,
    Jump,
    Kill,
    Sense,
    Unplug,
    Wrap,
)
from verification.faults_matrix.intruders import Stranger, second_robot
from verification.faults_matrix.results import Repetition, reason_name
from verification.faults_matrix.table import Fault, Must, Way
from verification.harness import motion
from verification.harness.inprocess import InProcess
from verification.harness.motion import PERIOD_S, Seen

STOPPING: Final = (Must.STOP, Must.STAND, Must.SAY)
SET_OFF_TICKS: Final = (4, 60)
HEALS_S: Final = 1.0
WATCHED_S: Final = 1.5
RUNS_OUT_S: Final = 0.5
"""For so long wheels may run out that were turning when the plant was stopped."""
LONGEST_S: Final = {True: 12.0, False: 300.0}
BEGIN_NS: Final = 60_000_000_000

GIVEN_UP_TICKS: Final = 40
WRAPS_AFTER: Final = 2500
"""Ticks of the encoders, half a metre."""
HEARS: Final = {
    ("robot", "plant"): ("sense/",),
    ("robot", "ground"): ("op/",),
    ("plant", "robot"): ("drive/",),
    ("ground", "robot"): ("tlm/", "drive/"),
    ("ground", "plant"): ("sense/", "truth/"),
}
"""Who hears what of whom."""


class Breakable(InProcess):
    """A stack whose control core can be made to raise an exception, which ends its process."""

    breaks = False
    stranger: Stranger | None = None

    def _sense(self) -> None:
        super()._sense()
        if self.stranger is not None:
            self.stranger.take_turn(self.send)

    def _think(self) -> None:
        if not self.breaks or self.robot is None:
            super()._think()
            return
        key = self.key_at_plant
        seen = self._arrivals.count(key)
        self.vehicle.state.odometry = None  # type: ignore[assignment]
        with suppress(AttributeError):
            self.robot.run(iter((Tick(self._ticks, self.clock.now_ns(), 0, 0),)))
        self._arrivals.wait(lambda: self._arrivals.count(key) > seen, "its last word")
        self.kill("robot")


class Drill:
    """A stack under way, one fault, and what came of it."""

    def __init__(self, fault: Fault, number: int) -> None:
        self._fault, self._number = fault, number
        self._stops = fault.must in STOPPING
        self._random = Random(f"{fault.name} {number}")
        world = world_for(fault.act, "corridor" if self._stops else "box")
        self.stack = Breakable(world, noise="default", seed=number, enforced=True)
        self.stack.clock.advance(BEGIN_NS)
        self._seen: list[Seen] = []
        self._known_s: float | None = None
        self._ticks = 0
        self._healed_s: float | None = None
        self._ended_ticks = 0

    def run(self) -> Repetition:
        with self.stack as stack:
            stack.forward(1.0)
            if not self._fault.at_rest:
                stack.arm()
                stack.goto_goal()
                stack.until(stack.driving, within_s=10.0)
            stack.forward(PERIOD_S * self._random.randint(*SET_OFF_TICKS))
            self._seen.append(Seen(0.0, stack.truth))
            before = self._random.randrange(len(stack.phases))
            for number, phase in enumerate(stack.phases):
                if number == before:
                    self.act(self._fault.act)
                phase()
            self._note()
            while not self._over():
                stack.cycle()
                self._note()
                self._heal_in_time()
            return self._found()

    @property
    def _now_s(self) -> float:
        return self._ticks * PERIOD_S

    def _note(self) -> None:
        """After a period: what is known at its begin, and where the robot is at its end."""
        stack = self.stack
        if stack.robot is not None and stack.state != VehicleState.ACTIVE and self._known_s is None:
            self._known_s = self._now_s
        self._ticks += 1
        if stack.plant is not None:
            self._seen.append(Seen(self._now_s, stack.truth))
        ended = stack.reached() or stack.state != VehicleState.ACTIVE
        self._ended_ticks = self._ended_ticks + 1 if ended else 0

    def _over(self) -> bool:
        if self._now_s >= LONGEST_S[self._stops]:
            return True
        if self._stops:
            return self._healed_s is not None and self._now_s >= self._healed_s + WATCHED_S
        return self._ended_ticks >= GIVEN_UP_TICKS

    def _heal_in_time(self) -> None:
        if self._healed_s is not None:
            return
        again_s = getattr(self._fault.act, "again_s", None)
        if again_s is None and self._stops:
            stood_s = motion.stood_s(self._seen)
            stands = self._known_s if self._fault.must is Must.SAY else stood_s
            again_s = None if stands is None else stands + HEALS_S
        if again_s is not None and self._now_s >= again_s:
            self._healed_s = self._now_s
            self.heal(self._fault.act)

    def act(self, act: Act) -> None:
        stack = self.stack
        match act:
            case Kill("router") | Hang("router"):
                self._cut(tuple(HEARS))
            case Kill(role):
                stack.kill(role)
            case Hang("ground"):
                stack.operator = False
            case Hang(role):
                stack.hanging |= {role}
            case Cut(one, other):
                self._cut(tuple(links_between(one, other)))
            case Deafen(who, whom):
                self._cut(((who, whom),))
            case Disturb(trouble):
                self._disturb(trouble)
            case Delay(delay_ms):
                self._disturb(LinkFaults(delay_ms=delay_ms, paths=("op/",)))
            case Double():
                self._second = second_robot(stack)
            case Exaggerate():
                stack.stranger = Stranger(stack.join(Role.GROUND))
            case Sense(kind, target, value):
                stack.inject(kind, target, value)
            case Jump(seconds):
                stack.clock.advance(round(seconds * NS_PER_S))
            case Break():
                stack.breaks = True
            case EmergencyStop():
                stack.command(Command.DO_FLIGHTTERMINATION, 1)
            case Wrap():
                """They wrap by themselves."""
            case _:
                raise NotImplementedError(f"{act} needs real processes")

    def heal(self, act: Act) -> None:
        """The end of the fault, where it has one."""
        stack = self.stack
        match act:
            case Kill("router") | Hang("router") | Cut() | Deafen() | Disturb():
                for bus in stack.buses.values():
                    bus.line.disturb(None)
            case Kill(role):
                stack.start(role)
                stack.reconnect()
            case Hang("ground"):
                stack.operator = True
            case Hang(role):
                stack.hanging -= {role}
            case Double():
                self._second.close()
            case Sense():
                stack.clear_faults()
            case _:
                """It stays as it is."""

    def _disturb(self, trouble: LinkFaults) -> None:
        seeded = replace(trouble, seed=self._number)
        for role in ("robot", "plant"):
            self.stack.buses[role].line.disturb(seeded)

    def _cut(self, links: tuple[tuple[str, str], ...]) -> None:
        for role, bus in self.stack.buses.items():
            paths = sum((HEARS[link] for link in links if link[0] == role), ())
            if paths:
                bus.line.disturb(LinkFaults(loss=1.0, paths=paths))

    def _found(self) -> Repetition:
        stack, seen = self.stack, self._seen
        machine = stack.vehicle.state.machine
        why = machine.vehicle_reason if stack.state != VehicleState.ACTIVE else machine.goal_reason
        visible = self._fault.must is not Must.SAY
        return Repetition(
            fault=self._fault.name,
            way=Way.LOCKSTEP.value,
            number=self._number,
            known_s=self._known_s,
            stood_s=motion.stood_s(seen) if visible else None,
            distance_m=motion.distance_m(seen) if self._stops and visible else None,
            reason=reason_name(why),
            reached=stack.reached(),
            contacts=motion.contacts(seen),
            touched_s=motion.touched_s(seen),
            moved_again=motion.moved_again(seen) if visible else self._drove_on(),
        )

    def _drove_on(self) -> bool:
        """Of a plant that was gone: does the robot move when it is back?"""
        back_s = LONGEST_S[True] if self._healed_s is None else self._healed_s + RUNS_OUT_S
        return any(not one.still for one in self._seen if one.at_s > back_s)


def links_between(one: str, other: str) -> Iterator[tuple[str, str]]:
    """Both directions; between somebody and the router that is whatever he hears and says."""
    for link in HEARS:
        if set(link) == {one, other} or ("router" in (one, other) and set(link) & {one, other}):
            yield link


def world_for(act: Act, name: str) -> World:
    """The world as it is, or with encoders that are about to wrap."""
    world = load(name)
    if not isinstance(act, Wrap):
        return world
    ticks = 2**31 - WRAPS_AFTER
    own = dict(world.robot) | {"left_start_ticks": ticks, "right_start_ticks": ticks}
    return replace(world, robot=own)


def run(fault: Fault, number: int) -> Repetition:
    """A repetition that breaks down is told, not lost."""
    try:
        if fault.act == Unplug():
            return power_cuts.run(fault.name, Way.LOCKSTEP.value, number)
        return Drill(fault, number).run()
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        return Repetition(
            fault=fault.name, way=Way.LOCKSTEP.value, number=number, trouble=why[:200]
        )
