"""Run one repetition in simulated time: the whole stack in this process, over real sockets.

The number of the repetition seeds the time of the fault, its phase in a control period and the
noise. A killed router and a cut link are made with the bus's fault injection, which drops all
frames. Processes that hang are skipped. An emulated board may run in the place of the core; it and
its line can be broken in several ways.
"""

import errno
import os
import re
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Final, NamedTuple, Self

from checks.faults import restarts
from checks.faults.bus_observer import ExtremeSender, second_robot
from checks.faults.cases import (
    RUNS_OUT_S,
    Act,
    BoardFault,
    BodyFault,
    Cut,
    DelayOperator,
    Disturb,
    DropOneWay,
    FaultCase,
    Hang,
    JumpClock,
    Kill,
    Must,
    PlainAct,
    Repetition,
    Way,
    reason_name,
)
from checks.harness.in_process import InProcess
from checks.harness.observer import Seen, contacts, distance_m, moved_again, stood_s, touched_s
from firmware.board import RESTART, Board, BoardError, Emulator, SerialLine
from firmware.host import BoardCore
from firmware.image import IMAGE
from plant.world.file import load
from protocol.bus.link_faults import LinkFaults
from protocol.topics import Role
from protocol.wire.enums import Command
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.messages import BoardRestart
from protocol.world import World
from robot.core.parameters import Params
from robot.core.values import Pose
from robot.hosting import InProcessCore
from runtime.clock import Tick
from runtime.errors import RemoteError
from runtime.units import NS_PER_S, PERIOD_S

MAX_GARBAGE: Final = 40
DEBUGGER_S: Final = 5.0
PROGRAM_COUNTER: Final = slice(15 * 8, 16 * 8)
"""Hexadecimal digits of register 15 among all registers."""
BRANCH_TO_ITSELF: Final = "fee7"
PACKET: Final = re.compile(rb"\$([^#]*)#..")
STOP_REPLY: Final = "T"
READ_BYTES: Final = 4096


class FaultyLine(SerialLine):
    """A serial line that may have a fault; `fault` is None while it is whole."""

    def __init__(self, line: SerialLine, random: Random) -> None:
        self.fault: BoardFault | None = None
        self._line, self._random = line, random
        self._garbage = b""

    def read(self, wait_s: float) -> bytes | None:
        """Return the bytes that have arrived, as `SerialLine` does."""
        if self.fault is BoardFault.CUT:
            return None
        if self.fault is not BoardFault.OUTPUT_LOST:
            garbage, self._garbage = self._garbage, b""
            return garbage or self._line.read(wait_s)
        until_s = monotonic() + wait_s
        while (left_s := until_s - monotonic()) > 0.0:
            self._line.read(left_s)
        return b""

    def write(self, data: bytes) -> None:
        """Write bytes, with garbage before them if that is the fault."""
        if self.fault is BoardFault.CUT:
            raise BrokenPipeError(errno.EPIPE, "cut")
        if self.fault is BoardFault.GARBAGE:
            self._line.write(self._bytes())
            self._garbage = self._bytes()
        if self.fault is not BoardFault.INPUT_LOST:
            self._line.write(data)

    def _bytes(self) -> bytes:
        return self._random.randbytes(self._random.randrange(MAX_GARBAGE))

    def close(self) -> None:
        """Close nothing: the line belongs to its emulator."""


class BreakableBoard:
    """Starts an emulated board for each core that is created; faults concern the newest."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._scope.close()

    def new_core(self, params: Params, start: Pose, totals: tuple[int, int]) -> BoardCore:
        """Return a core on a new board; the one before is switched off."""
        self._scope.close()
        folder = Path(self._scope.enter_context(TemporaryDirectory(prefix="sidestep-debugger-")))
        self._debugger = folder / "gdb"
        debugger = f"socket,id=gdb,path={self._debugger},server=on,wait=off"
        options = ("-chardev", debugger, "-gdb", "chardev:gdb")
        self._emulator = self._scope.enter_context(Emulator(IMAGE.elf, extra=options))
        self._line = FaultyLine(self._emulator.line, self._random)
        self._board = Board(self._line)
        self._board.wait_for_hello()
        return BoardCore(self._board, params, start, totals)

    def inject(self, fault: BoardFault) -> None:
        """Inject a fault into the board or its line."""
        match fault:
            case BoardFault.HANG:
                hang(self._debugger)
            case BoardFault.SUSPEND:
                os.kill(self._emulator.pid, signal.SIGSTOP)
            case BoardFault.KILL:
                os.kill(self._emulator.pid, signal.SIGKILL)
            case BoardFault.RESET:
                self._board.send(BoardRestart(confirmation=RESTART))
            case _:
                self._line.fault = fault


def hang(path: Path) -> None:
    """Overwrite the next instruction with a branch to itself, as a debugger can."""
    with debugging(path) as ask:
        counter = int.from_bytes(bytes.fromhex(ask("g")[PROGRAM_COUNTER]), "little")
        ask(f"M{counter:x},2:{BRANCH_TO_ITSELF}")


@contextmanager
def debugging(path: Path) -> Iterator["Debugger"]:
    """Halt an emulator by its debugger interface; let it continue afterwards."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(DEBUGGER_S)
        line.connect(str(path))
        debugger = Debugger(line)
        yield debugger
        debugger.order("D")


class Debugger:
    """The remote protocol of GDB: one packet out, one packet in; stop replies are skipped."""

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self._received = b""

    def __call__(self, packet: str) -> str:
        """Send a packet and return the contents of the answer."""
        self.order(packet)
        while (answer := self._packet()).startswith(STOP_REPLY):
            pass
        return answer

    def _packet(self) -> str:
        """Return the contents of the next packet, and acknowledge it."""
        while (found := PACKET.search(self._received)) is None:
            data = self._line.recv(READ_BYTES)
            if not data:
                raise RemoteError("the debugger interface of the emulator has closed")
            self._received += data
        self._received = self._received[found.end() :]
        self._line.sendall(b"+")
        return found[1].decode()

    def order(self, packet: str) -> None:
        """Send a packet."""
        body = packet.encode()
        self._line.sendall(b"$" + body + b"#" + f"{sum(body) & 0xFF:02x}".encode())


HEALS_S: Final = 1.0
NEAR_X_M: Final = 1.8
PAST_CORNER_M: Final = (3.0, 2.6)
"""Start and goal in the short form: they keep contacts with the box, in a third of the time."""
LONGEST_S: Final = {True: 12.0, False: 300.0}
BEGIN_NS: Final = 60_000_000_000

WRAPS_AFTER: Final = 2500
"""Encoder ticks, half a metre."""
RECEIVES: Final = {
    ("robot", "plant"): ("sense/",),
    ("robot", "ground"): ("op/",),
    ("plant", "robot"): ("drive/",),
    ("ground", "robot"): ("tlm/", "drive/"),
    ("ground", "plant"): ("sense/", "truth/"),
}
"""Topics that each process receives from each other."""


class Timing(NamedTuple):
    """The simulated time of a repetition beside the reaction itself.

    The robot is at rest for `settles_s`, then drives for `set_off_ticks` (at least, at most) until
    the fault, and is watched for `watched_s` after the end of the fault, or for `ended_ticks` after
    the end of its drive.
    """

    settles_s: float
    set_off_ticks: tuple[int, int]
    watched_s: float
    ended_ticks: int


FULL: Final = Timing(1.0, (4, 60), 1.5, 40)
SHORT: Final = Timing(0.25, (4, 20), 1.0, 20)


class BreakableInProcess(InProcess):
    """A stack whose control core or board can fail, which ends the robot process.

    While `breaks` is set, the next tick of the robot process must fail.
    """

    breaks = False
    extreme_sender: ExtremeSender | None = None

    def break_core(self) -> None:
        """Let the core raise an exception in its next step."""
        self.vehicle.state.odometry = None  # type: ignore[assignment]
        self.breaks = True

    def _sense(self) -> None:
        super()._sense()
        if self.extreme_sender is not None:
            self.extreme_sender.take_turn(self.send)

    def _think(self) -> None:
        if not self.breaks or self.robot is None:
            super()._think()
            return
        key = self.key_at_plant
        seen = self._arrivals.count(key)
        try:
            self.robot.run(iter((Tick(self._ticks, self.clock.now_ns(), 0, 0),)))
        except (AttributeError, BoardError):
            """The core or its board is broken."""
        else:
            raise RuntimeError("the robot process has not ended")
        self._arrivals.wait(
            lambda: self._arrivals.count(key) > seen, "the robot's last wheel command"
        )
        self.kill("robot")


class LockstepDrill:
    """A driving stack, one fault, and the observed reaction.

    With `short` a robot that goes on starts nearer to the box and need only pass its corner.
    """

    def __init__(self, fault: FaultCase, number: int, *, short: bool = False) -> None:
        self._fault, self._number = fault, number
        self._timing = SHORT if short else FULL
        self._stops = fault.must_stop
        self._random = Random(f"{fault.name} {number}")
        world = world_for(fault.act, "corridor" if self._stops else "box")
        if short and not self._stops:
            world = nearer(world)
        is_on_board = isinstance(fault.act, BoardFault)
        self._board = BreakableBoard(self._random) if is_on_board else None
        new_core = InProcessCore if self._board is None else self._board.new_core
        self.stack = BreakableInProcess(
            world, noise="default", seed=number, enforced=True, new_core=new_core
        )
        self.stack.clock.advance(BEGIN_NS)
        self._seen: list[Seen] = []
        self._known_s: float | None = None
        self._ticks = 0
        self._healed_s: float | None = None
        self._ended_ticks = 0

    def run(self) -> Repetition:
        """Drive, cause the fault and return the reaction."""
        with self._board or nullcontext(), self.stack as stack:
            stack.forward(self._timing.settles_s)
            if not self._fault.at_rest:
                stack.arm()
                stack.goto_goal()
                stack.until(stack.driving, within_s=10.0)
            stack.forward(PERIOD_S * self._random.randint(*self._timing.set_off_ticks))
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
        """Note what is known at the begin of a period and the position at its end."""
        stack = self.stack
        if stack.robot is not None and stack.state != VehicleState.ACTIVE and self._known_s is None:
            self._known_s = self._now_s
        self._ticks += 1
        if stack.plant is not None:
            self._seen.append(Seen(self._now_s, stack.truth))
        ended = stack.reached() or stack.state != VehicleState.ACTIVE
        self._ended_ticks = self._ended_ticks + 1 if ended else 0

    def _over(self) -> bool:
        timing = self._timing
        if self._now_s >= LONGEST_S[self._stops]:
            return True
        if self._stops:
            return self._healed_s is not None and self._now_s >= self._healed_s + timing.watched_s
        return self._ended_ticks >= timing.ended_ticks

    def _heal_in_time(self) -> None:
        if self._healed_s is not None:
            return
        again_s = getattr(self._fault.act, "again_s", None)
        if again_s is None and self._stops:
            stands_s = self._known_s if self._fault.must is Must.SAY else stood_s(self._seen)
            again_s = None if stands_s is None else stands_s + HEALS_S
        if again_s is not None and self._now_s >= again_s:
            self._healed_s = self._now_s
            self.heal(self._fault.act)

    def act(self, act: Act) -> None:
        """Cause the fault."""
        stack = self.stack
        match act:
            case Kill("router") | Hang("router"):
                self._cut(tuple(RECEIVES))
            case Kill(role):
                stack.kill(role)
            case Hang("ground"):
                stack.operator = False
            case Hang(role):
                stack.hanging |= {role}
            case Cut(one, other):
                self._cut(tuple(links_between(one, other)))
            case DropOneWay(receiver, sender):
                self._cut(((receiver, sender),))
            case Disturb(trouble):
                self._disturb(trouble)
            case DelayOperator(delay_ms):
                self._disturb(LinkFaults(delay_ms=delay_ms, paths=("op/",)))
            case PlainAct.SECOND_ROBOT:
                self._second = second_robot(stack)
            case PlainAct.EXTREME_FRAMES:
                stack.extreme_sender = ExtremeSender(stack.join(Role.GROUND))
            case BodyFault(kind, target, value):
                stack.inject(kind, target, value)
            case JumpClock(seconds):
                stack.clock.advance(round(seconds * NS_PER_S))
            case PlainAct.RAISE_IN_CORE:
                stack.break_core()
            case BoardFault():
                self._break_board(act)
            case PlainAct.EMERGENCY_STOP:
                stack.command(Command.DO_FLIGHTTERMINATION, 1)
            case PlainAct.WRAP_ENCODERS:
                """The world starts with counters that are about to wrap."""
            case _:
                raise NotImplementedError(f"{act} is only possible with real processes")

    def _break_board(self, fault: BoardFault) -> None:
        assert self._board is not None
        self._board.inject(fault)
        self.stack.breaks = self._stops

    def heal(self, act: Act) -> None:
        """End the fault, if it has an end."""
        stack = self.stack
        match act:
            case Kill("router") | Hang("router") | Cut() | DropOneWay() | Disturb():
                for bus in stack.buses.values():
                    bus.faults.disturb(None)
            case Kill(role):
                stack.start(role)
                stack.reconnect()
            case BoardFault():
                stack.breaks = False
                stack.start("robot")
                stack.reconnect()
            case Hang("ground"):
                stack.operator = True
            case Hang(role):
                stack.hanging -= {role}
            case PlainAct.SECOND_ROBOT:
                self._second.close()
            case BodyFault():
                stack.clear_faults()
            case _:
                """This fault does not end."""

    def _disturb(self, trouble: LinkFaults) -> None:
        seeded = replace(trouble, seed=self._number)
        for role in ("robot", "plant"):
            self.stack.buses[role].faults.disturb(seeded)

    def _cut(self, links: tuple[tuple[str, str], ...]) -> None:
        for role, bus in self.stack.buses.items():
            paths = sum((RECEIVES[link] for link in links if link[0] == role), ())
            if paths:
                bus.faults.disturb(LinkFaults(loss=1.0, paths=paths))

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
            stood_s=stood_s(seen) if visible else None,
            distance_m=distance_m(seen) if self._stops and visible else None,
            reason=reason_name(why),
            reached=stack.reached(),
            contacts=contacts(seen),
            touched_s=touched_s(seen),
            moved_again=moved_again(seen) if visible else self._drove_on(),
        )

    def _drove_on(self) -> bool:
        """Return whether the robot moves after the plant is back."""
        back_s = LONGEST_S[True] if self._healed_s is None else self._healed_s + RUNS_OUT_S
        return any(not one.still for one in self._seen if one.at_s > back_s)


def links_between(one: str, other: str) -> Iterator[tuple[str, str]]:
    """Yield both directions; for the router, all links of the other process."""
    for link in RECEIVES:
        if set(link) == {one, other} or ("router" in (one, other) and set(link) & {one, other}):
            yield link


def world_for(act: Act, name: str) -> World:
    """Load a world, with encoders that are about to wrap if the act needs that."""
    world = load(name)
    if act is not PlainAct.WRAP_ENCODERS:
        return world
    ticks = 2**31 - WRAPS_AFTER
    own = dict(world.robot) | {"left_start_ticks": ticks, "right_start_ticks": ticks}
    return replace(world, robot=own)


def nearer(world: World) -> World:
    """Return the world of the box with start and goal near the corner that must be passed."""
    x_m, y_m = PAST_CORNER_M
    goal = replace(world.goal, x_m=x_m, y_m=y_m, heading_rad=None)
    return replace(world, start=replace(world.start, x_m=NEAR_X_M), goal=goal)


def run(fault: FaultCase, number: int, *, short: bool = False) -> Repetition:
    """Run a repetition; a failure becomes a repetition with `trouble`."""
    try:
        if fault.act is PlainAct.POWER_CUT:
            return restarts.run(fault.name, Way.LOCKSTEP.value, number)
        return LockstepDrill(fault, number, short=short).run()
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        return Repetition(
            fault=fault.name, way=Way.LOCKSTEP.value, number=number, trouble=why[:200]
        )
