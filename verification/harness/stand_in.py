"""The real robot process, and in this one a stand-in for plant and operator that keeps it driving.

The stand-in publishes by the plant's own wires, so what is measured is what a plant would see.
"""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from itertools import count
from pathlib import Path
from threading import Event
from time import monotonic_ns
from typing import NamedTuple

from plant.model.configuration import noise_of
from plant.model.types import World
from plant.process.robot_link import RobotLink
from plant.sim.simulation import Plant
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network, Tls
from protocol.topics import COMMAND, STATUS, Role
from protocol.wire.enums import AckResult, Command, GoalState, Mode
from protocol.wire.goal import WireGoal, start_words, wire_goal
from protocol.wire.messages import CommandAck, CommandRequest, GoalRequest
from study.trial.trial import wire_goal_of
from verification.harness.pace import paced
from verification.harness.processes import free_port, sidestep

ROBOT = "r1"
ANSWER_WITHIN_S = 0.04
READY_WITHIN_S = 10.0
STANDS_AFTER = 4
SETS_OFF_WITHIN = 100


class Standin:
    """One robot's world, advanced by whoever measures; `operator` is the bus that sets goals."""

    def __init__(self, bus: Bus, operator: Bus, world: World, *, lockstep: bool) -> None:
        self.plant = Plant(world, 0, noise_of(world))
        self.bus = bus
        self._operator = operator
        self._arrived = Event()
        self._arrived_ns = 0
        self._wires = RobotLink(bus, ROBOT, 0, self._notice, lockstep=lockstep)
        self._status = bus.mailbox(STATUS, ROBOT)
        self._goals = (wire_goal_of(world), back_to_start(world))
        self._requests = count(monotonic_ns())
        self._turns = count()
        self._standing = 0
        self._errand: Future[None] | None = None
        self._pool = ThreadPoolExecutor(1)
        missing = bus.await_matched(self._wires.publishers, READY_WITHIN_S)
        if missing:
            raise RuntimeError(f"the robot does not subscribe to {', '.join(missing)}")

    def tick(self, patience_s: float = ANSWER_WITHIN_S) -> int | None:
        """Publish the senses, take the wheel command, let a period go by.

        Returns the nanoseconds from before the first put to the arrival of the command that
        answers these very senses, None when none came in time.
        """
        frames = self._wires.framed(self.plant)
        self._arrived.clear()
        published_ns = monotonic_ns()
        for publisher, frame in frames:
            publisher.put_frame(frame)
        self._wires.tell(self.plant)
        while answered := self._arrived.wait(patience_s):
            if self._wires.answered:
                break
            self._arrived.clear()
        took_ns = self._arrived_ns - published_ns
        self._wires.obey(self.plant)
        self.plant.advance()
        self._keep_driving()
        return took_ns if answered else None

    @property
    def drives(self) -> bool:
        newest = self._status.latest()
        return newest is not None and GoalState.ACCEPTED <= newest[0].goal <= GoalState.ALIGNING

    def close(self) -> None:
        self._pool.shutdown(cancel_futures=True)

    def _keep_driving(self) -> None:
        """Set off again when the goal has ended. Asking takes ticks, so it is done in a thread."""
        if self._errand is not None:
            if not self._errand.done():
                return
            self._errand.result()
            self._errand, self._standing = None, 0
        self._standing = 0 if self.drives else self._standing + 1
        if self._standing >= STANDS_AFTER:
            self._errand = self._pool.submit(self._set_off)

    def _set_off(self) -> None:
        """Arm, and drive to the goal and back to the start in turn."""
        self._ask(
            CommandRequest(
                request_id=next(self._requests),
                param1=1.0,
                param2=0.0,
                command=Command.COMPONENT_ARM_DISARM,
            )
        )
        goal = self._goals[next(self._turns) % 2]
        self._ask(GoalRequest(request_id=next(self._requests), mode=Mode.AUTO, **goal._asdict()))

    def _ask(self, request: CommandRequest | GoalRequest) -> None:
        answer = self._operator.ask(COMMAND, request, robot=ROBOT)
        if not isinstance(answer, CommandAck) or answer.result != AckResult.ACCEPTED:
            raise RuntimeError(f"the robot refused {request}: {answer!r}")

    def _notice(self, arrived_ns: int) -> None:
        self._arrived_ns = arrived_ns
        self._arrived.set()


class RobotProcess(NamedTuple):
    """`sidestep robot`, and how to reach it."""

    pid: int
    said: list[str]
    network: Network


@contextmanager
def robot_process(world: World, *options: str, keys: Path | None = None) -> Iterator[RobotProcess]:
    """With `keys`, a folder of `sidestep keys new`, it is locked, and the stand-in let in."""
    endpoint = f"{'tls' if keys else 'tcp'}/127.0.0.1:{free_port()}"
    start = start_words(world.start.x_m, world.start.y_m, world.start.heading_rad)
    locked = ("--config", str(keys / f"robot-{ROBOT}.toml")) if keys else ()
    arguments = ("robot", "--id", ROBOT, "--listen", endpoint, "--start", *start, *locked, *options)
    with sidestep(*arguments, ready="ready") as robot:
        network = Network(mode="client", connect=(endpoint,), tls=tls_of(keys) if keys else None)
        yield RobotProcess(robot.pid, robot.said, network)


def tls_of(keys: Path) -> Tls:
    """The router's: one certificate for the plant and the operator that a stand-in is."""
    certificate, key = str(keys / "router.pem"), str(keys / "router.key")
    return Tls(ca=str(keys / "ca.pem"), certificate=certificate, key=key)


@contextmanager
def driving(world: World, robot: RobotProcess, *, lockstep: bool) -> Iterator[Standin]:
    """A stand-in whose robot is on its way."""
    with (
        open_bus(robot.network, Role.PLANT, ROBOT) as bus,
        open_bus(robot.network, Role.GROUND, ROBOT) as operator,
    ):
        standin = Standin(bus, operator, world, lockstep=lockstep)
        with closing(standin):
            for _ in paced(SETS_OFF_WITHIN):
                standin.tick(patience_s=1.0 if lockstep else ANSWER_WITHIN_S)
                if standin.drives:
                    break
            yield standin


def back_to_start(world: World) -> WireGoal:
    return wire_goal(world.start.x_m, world.start.y_m, None, 0.1, 0.1)
