"""Forged wheel commands on an open bus do not move the wheels of a stopped robot."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain, repeat

from protocol.topics import DRIVE
from protocol.wire.codec import Encoder
from protocol.wire.enums import Command, Vehicle
from protocol.wire.messages import WheelCommand
from protocol.wire.reasons import Reason
from runtime.units import PERIOD_NS
from tests.support.each import each
from tests.support.harness import Stack
from tests.support.until import PATIENCE_S

UINT32 = 0xFFFFFFFF
UINT16 = 0xFFFF
FAST = 9000
STANDS_S = 0.25
"""200 ms, and the period after them in which no wheel may move."""

WATCHED_S = 2.0


def forged(sense_seq: int, *, seq: int = UINT32, epoch: int = 0, ttl_ms: int = UINT16) -> bytes:
    command = WheelCommand(
        time_ns=0,
        seq=seq,
        sense_seq=sense_seq & UINT32,
        epoch=epoch,
        left_mrad_s=FAST,
        right_mrad_s=FAST,
        ttl_ms=ttl_ms,
    )
    return Encoder(1, 1).encode(command)


Forge = Callable[[int], bytes]
"""Return the frames to send at this tick of the plant."""

FRAMES: dict[str, Forge] = {
    "finding A3": lambda tick: forged(UINT32),
    "next tick": lambda tick: forged(tick + 1),
    "this tick": forged,
    "this tick, newest epoch": lambda tick: forged(tick, epoch=UINT32),
    "an earlier tick": lambda tick: forged(tick - 2, epoch=UINT32),
    "a tick long ago": lambda tick: forged(tick - 20),
}

ANSWERS = {"this tick", "this tick, newest epoch", "an earlier tick"}
"""Return those frames that answer a tick within its time-to-live."""


class Attacked(Stack):
    """A stack with an attacker on its bus, which sends before and after the robot in each tick."""

    before: Iterator[Sequence[Forge]] = repeat(())
    after: Iterator[Sequence[Forge]] = repeat(())

    def __enter__(self) -> "Attacked":
        super().__enter__()
        self._forger = self.ground.publisher(DRIVE)
        assert self.ground.await_matched([self._forger], PATIENCE_S) == []
        return self

    def _think(self) -> None:
        self._forge(next(self.before))
        super()._think()
        self._forge(next(self.after))

    def _forge(self, forges: Sequence[Forge]) -> None:
        """Send a frame, and wait until the plant has received it."""
        assert self.plant is not None
        for forge in forges:
            frame, key = forge(self.plant.plant.now_ns // PERIOD_NS), self.key_at_plant
            self._send(key, partial(self._forger.put_frame, frame), self.plant)

    def attack(self, *forges: Forge, always: bool = False) -> None:
        """Send these from the next tick on, once before the robot's command or always around it."""
        if always:
            self.before, self.after = repeat(forges), repeat(forges)
        else:
            self.before = chain([forges], repeat(()))

    def stands_throughout(self, seconds: float) -> bool:
        for _ in range(round(seconds * 20)):
            self.forward(0.05)
            if not self.standing():
                return False
        return True


def stopped(stack: Attacked) -> None:
    """Drive, then press the emergency stop."""
    stack.arm()
    stack.goto_goal()
    stack.until(stack.driving)
    assert stack.command(Command.DO_FLIGHTTERMINATION, 1) == Reason.NONE
    stack.until(stack.standing)
    assert stack.state == Vehicle.EMERGENCY_STOP


def disarmed(stack: Attacked) -> None:
    stack.forward(1.0)


@each("name", FRAMES)
@each("prepare", [disarmed, stopped])
def test_one_frame_moves_no_wheel(name: str, prepare: Callable[[Attacked], None]) -> None:
    with Attacked("open") as stack:
        prepare(stack)
        stack.attack(FRAMES[name])
        assert stack.stands_throughout(STANDS_S)


def test_robot_drives_normally_after_the_frame_of_finding_a3() -> None:
    with Attacked("open") as stack:
        stack.attack(FRAMES["finding A3"])
        stack.forward(0.05)
        stack.arm()
        stack.goto_goal()
        stack.until(stack.reached, within_s=60.0)


@each("prepare", [disarmed, stopped])
def test_a_stream_of_frames_moves_no_wheel(prepare: Callable[[Attacked], None]) -> None:
    with Attacked("open") as stack:
        prepare(stack)
        stack.attack(*FRAMES.values(), always=True)
        assert stack.stands_throughout(WATCHED_S)


def test_an_emergency_stop_holds_while_frames_stream() -> None:
    with Attacked("open") as stack:
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving)
        stack.attack(*FRAMES.values(), always=True)
        stack.forward(0.2)
        assert stack.command(Command.DO_FLIGHTTERMINATION, 1) == Reason.NONE
        stack.forward(STANDS_S)
        assert stack.stands_throughout(WATCHED_S)


@each("name", FRAMES)
def test_one_frame_moves_a_dead_robot_for_at_most_200_ms(name: str) -> None:
    """Attackers on an open bus may answer a tick as the robot does: for 150 ms, not longer."""
    with Attacked("open", router=True) as stack:
        stack.kill("robot")
        stack.forward(0.5)
        stack.attack(FRAMES[name])
        moved = not stack.stands_throughout(0.05)
        assert moved == (name in ANSWERS)
        stack.forward(STANDS_S - 0.05)
        assert stack.stands_throughout(WATCHED_S)
