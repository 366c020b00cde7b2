"""A substitute for plant and operator that keeps a real robot process driving.

It publishes through the plant's own robot link, so a measurement sees what a plant would see. It is
paced by the wall clock at the control rate.
"""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from itertools import count, cycle
from threading import Event
from time import monotonic_ns

from checks.harness.bus_calls import arm_request, auto_goal_request, await_subscribers, is_accepted
from checks.harness.processes import ROBOT, StartedRobot
from plant.model.configuration import noise_of
from plant.process.robot_link import RobotLink
from plant.sim.simulation import Plant
from protocol.bus.bus import Bus, open_bus
from protocol.outcome import wire_goal
from protocol.topics import COMMAND, STATUS, Role
from protocol.wire.enums import GoalState
from protocol.wire.messages import CommandAck, CommandRequest, GoalRequest
from protocol.wire.reasons import Reason
from protocol.world import World
from runtime.clock import WallClock, ticks
from runtime.units import CONTROL_HZ
from study.trial.trial import wire_goal_of


def paced(count: int) -> Iterator[int]:
    """Yield the monotonic time in ns at which each of `count` ticks was due."""
    for tick, _ in zip(ticks(WallClock(), CONTROL_HZ), range(count), strict=False):
        yield tick.due_ns


def wait_until(deadline_ns: int) -> None:
    """Sleep until a monotonic time."""
    WallClock().sleep_until(deadline_ns)


ANSWER_WITHIN_S = 0.04
READY_WITHIN_S = 10.0
STANDS_AFTER = 4
BUSY = (Reason.BUDGET, Reason.NOT_ARMED)
"""Why a robot whose loop is too slow refuses to be armed, or, disarmed since, to drive."""
SETS_OFF_WITHIN = 100


class PlantStandIn:
    """A plant with one robot that a measurement advances; `operator` is the bus for goals."""

    def __init__(self, bus: Bus, operator: Bus, world: World, *, lockstep: bool) -> None:
        self.plant = Plant(world, 0, noise_of(world))
        self.bus = bus
        self._operator = operator
        self._arrived = Event()
        self._arrived_ns = 0
        self._link = RobotLink(bus, ROBOT, 0, self._notice, lockstep=lockstep)
        self._status = bus.mailbox(STATUS, ROBOT)
        back = wire_goal(world.start.x_m, world.start.y_m, None, 0.1, 0.1)
        self._goals = cycle((wire_goal_of(world), back))
        self._requests = count(monotonic_ns())
        self._ticks_without_goal = 0
        self._departure: Future[None] | None = None
        self._pool = ThreadPoolExecutor(1)
        await_subscribers(bus, self._link.publishers, READY_WITHIN_S)

    def tick(self, patience_s: float = ANSWER_WITHIN_S) -> int | None:
        """Publish the senses, take the wheel command and advance one period.

        Return the nanoseconds from before the first put to the arrival of the command that answers
        these senses; None when none arrived in time.
        """
        frames = self._link.frames(self.plant)
        self._arrived.clear()
        published_ns = monotonic_ns()
        for publisher, frame in frames:
            publisher.put_frame(frame)
        self._link.publish_clock_and_truth(self.plant)
        while answered := self._arrived.wait(patience_s):
            if self._link.answered:
                break
            self._arrived.clear()
        took_ns = self._arrived_ns - published_ns
        self._link.apply_command(self.plant)
        self.plant.advance()
        self._keep_driving()
        return took_ns if answered else None

    @property
    def drives(self) -> bool:
        """True if the robot has a goal that has not ended."""
        newest = self._status.latest()
        return newest is not None and GoalState.ACCEPTED <= newest[0].goal <= GoalState.ALIGNING

    def close(self) -> None:
        """Cancel requests that have not been sent."""
        self._pool.shutdown(cancel_futures=True)

    def _keep_driving(self) -> None:
        """Set off again when the goal has ended, in a thread: an answer takes ticks."""
        if self._departure is not None:
            if not self._departure.done():
                return
            self._departure.result()
            self._departure, self._ticks_without_goal = None, 0
        self._ticks_without_goal = 0 if self.drives else self._ticks_without_goal + 1
        if self._ticks_without_goal >= STANDS_AFTER:
            self._departure = self._pool.submit(self._set_off)

    def _set_off(self) -> None:
        """Arm, and drive to the goal and back to the start in turn; or wait for a better moment."""
        if self._obeys(arm_request(next(self._requests))):
            self._obeys(auto_goal_request(next(self._requests), next(self._goals)))

    def _obeys(self, request: CommandRequest | GoalRequest) -> bool:
        """Ask for something; return False if the robot's own loop is too slow at the moment.

        It may also have been too slow since it was armed, and have disarmed itself.

        Raises:
            RuntimeError: It refuses for another reason, which waiting does not change.
        """
        answer = self._operator.ask(COMMAND, request, robot=ROBOT)
        if is_accepted(answer):
            return True
        if isinstance(answer, CommandAck) and answer.result_param2 in BUSY:
            return False
        raise RuntimeError(f"the robot refused {request}: {answer!r}")

    def _notice(self, arrived_ns: int) -> None:
        self._arrived_ns = arrived_ns
        self._arrived.set()


@contextmanager
def driving(world: World, robot: StartedRobot, *, lockstep: bool) -> Iterator[PlantStandIn]:
    """Run a plant and keep its robot driving."""
    with (
        open_bus(robot.network, Role.PLANT, ROBOT) as bus,
        open_bus(robot.network, Role.GROUND, ROBOT) as operator,
    ):
        standin = PlantStandIn(bus, operator, world, lockstep=lockstep)
        with closing(standin):
            for _ in paced(SETS_OFF_WITHIN):
                standin.tick(patience_s=1.0 if lockstep else ANSWER_WITHIN_S)
                if standin.drives:
                    break
            yield standin
