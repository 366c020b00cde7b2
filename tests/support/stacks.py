"""The stack in one process: driven tick by tick or on its own, with its operators."""

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from math import nan
from typing import Any, Final

import pytest

from checks.harness.in_process import InProcess, reason_in
from checks.harness.processes import OPERATOR_BEAT
from checks.harness.until import PATIENCE_S, until
from ground import robot
from ground.client.connection import Common
from ground.client.vocabulary import Remedies
from ground.station.link.loss import LossKind
from ground.station.station import Station
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import (
    COMMAND,
    LEASE_SERVICE,
    MISSION_SERVICE,
    OPERATOR,
    PARAMETER,
    TELEOP,
    Role,
    Service,
)
from protocol.wire.enums import FRAME_LOCAL_FLU, Command, LeaseAction, MissionType, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    LeaseRequest,
    MissionCount,
    MissionItemInt,
    MissionVerdict,
    ParamSet,
    Teleop,
)
from protocol.wire.reasons import Reason
from runtime.clock import Tick, WallClock
from runtime.units import PERIOD_NS

STOPPING_S = 0.40
"""From the failsafe to a standing robot: braking from 0.3 m/s and the lag of the motors."""


PERIOD_S: Final = PERIOD_NS / 1e9
POLL_S: Final = 0.05


class Lively(InProcess):
    """A stack without lockstep. `hung`: the robot's loop stops; `mute`: the plant stops."""

    period_s = PERIOD_S
    """Between two ticks, which are always 50 ms of simulated time apart."""

    def __init__(self, *, router: bool = False, parameters: dict[str, float] | None = None) -> None:
        super().__init__("open", router=router, parameters=parameters)
        self.hung = self.mute = False
        self._turning = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._go_on, daemon=True)

    @contextmanager
    def going(self) -> Iterator[None]:
        self._thread.start()
        try:
            yield
        finally:
            self._over.set()
            self._thread.join()

    @contextmanager
    def halted(self) -> Iterator[None]:
        """Pause the stack, so that processes can be stopped and started."""
        with self._turning:
            yield

    def start(self, name: str) -> None:
        """Start a process; a restarted plant advances to the time of the others."""
        super().start(name)
        while self.plant is not None and self.plant.plant.now_ns < self.clock.now_ns():
            self.plant.advance()

    def _go_on(self) -> None:
        while not self._over.wait(self.period_s):
            with self._turning:
                self._turn()

    def _turn(self) -> None:
        if self.plant is not None and not self.mute:
            self.plant.publish()
        if self.robot is not None and not self.hung:
            self.robot.cycle(Tick(self._ticks, self.clock.now_ns(), 0, 0))
        if self.plant is not None and not self.mute:
            self.plant.advance()
        self._ticks += 1
        self.clock.advance(PERIOD_NS)


class Paced(Lively):
    """A stack in which each process waits for the other, and misses its operator after a minute.

    So no failsafe of a busy machine ends what a program drives.
    """

    def __init__(self) -> None:
        super().__init__(parameters={"op_lost_ms": 60_000})

    def _turn(self) -> None:
        self.cycle()


class Watching:
    """A station with a link and an event loop of its own, polled by the waiting test."""

    def __init__(self, bus: Bus, common: Common, name: str) -> None:
        self.loop = asyncio.new_event_loop()
        self.station = Station(
            bus, common.robot, WallClock(), name=name, common=common, begin=self._begin
        )

    def _begin(self, work: Coroutine[Any, Any, None]) -> object:
        """Begin a command in the loop that runs: that of the app, if there is one."""
        try:
            return asyncio.create_task(work)
        except RuntimeError:
            return self.loop.create_task(work)

    def turn(self) -> None:
        """Let the loop do what it can do now, and poll."""
        self._go_on()
        self.station.poll()

    def _go_on(self) -> None:
        self.loop.call_soon(self.loop.stop)
        self.loop.run_forever()

    def close(self) -> None:
        self.loop.run_until_complete(self.station.close())
        for task in asyncio.all_tasks(self.loop):
            task.cancel()
        self._go_on()
        self.loop.close()

    def until(self, condition: Callable[[], object], within_s: float = PATIENCE_S) -> float:
        """Poll until it holds; how long that took."""

        def met() -> object:
            self.turn()
            return condition()

        return until(
            met,
            within_s=within_s,
            what=lambda: "\n".join(map(str, self.station.log)),
            poll_s=POLL_S,
        )

    def until_lost(self, kind: LossKind) -> float:
        return self.until(lambda: (loss := self.station.loss()) and loss.kind is kind)

    def until_ready(self) -> float:
        return self.until(lambda: self.station.ready)

    def kinds(self) -> list[str]:
        """Return the names of the losses reported so far.

        Without those for a moment that a busy machine adds, because plant and robot are threads of
        this process: a loss of sensor data, and of a link, beside another loss.
        """
        names = [kind.value for kind in LossKind]
        found = [
            name for line in self.station.log for name in names if line.text.startswith(f"{name} ")
        ]
        for late in (LossKind.SENSES_STALE.value, LossKind.TRANSPORT.value):
            if set(found) - {late}:
                found = [name for name in found if name != late]
        return list(dict.fromkeys(found))


@contextmanager
def watching(
    stack: InProcess, endpoint: str | None = None, name: str = "anna"
) -> Iterator[Watching]:
    hub, prefix = endpoint or stack._hub, stack._prefix
    network = Network(mode="client", connect=(hub,), prefix=prefix, person=name)
    with open_bus(network, Role.GROUND, "r1") as bus:
        seen = Watching(bus, Common(network=network, robot="r1"), name)
        try:
            yield seen
        finally:
            seen.close()


def dials(stack: Lively, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Options by which a program finds the stack; `config` is the person who uses it."""

    def common(
        endpoint: str | None, _: str | None, config: str | None, *, remedies: Remedies
    ) -> Common:
        assert endpoint is not None
        network = Network(
            mode="client", connect=(endpoint,), prefix=stack._prefix, person=config or ""
        )
        return Common(network=network, robot="r1", remedies=remedies)

    monkeypatch.setattr(robot, "common", common)
    return ["--connect", stack._hub]


Place = tuple[float, float]


class Operator:
    """Sends requests, heartbeats and teleop frames only when the test calls it."""

    def __init__(self, stack: InProcess, name: str) -> None:
        self.name = name
        self._stack = stack
        self._bus = stack.join(Role.GROUND, name)
        self._beats = self._bus.publisher(OPERATOR)
        self._handle = self._bus.publisher(TELEOP)
        self._frames = 0
        self._requests = 1000 * (1 + len(name))
        assert self._bus.await_matched([self._beats, self._handle], PATIENCE_S) == []

    def ask(self, request: Message, service: Service = COMMAND) -> Message:
        return self._stack.ask(request, service, self._bus)

    def command(self, command: Command, param1: float = 0.0, param2: float = 0.0) -> Reason:
        self._requests += 1
        request = CommandRequest(
            request_id=self._requests, command=command, param1=param1, param2=param2
        )
        return reason_in(self.ask(request))

    def lease(self, action: LeaseAction) -> Reason:
        self._requests += 1
        request = LeaseRequest(request_id=self._requests, action=action, name=self.name)
        return reason_in(self.ask(request, LEASE_SERVICE))

    def manual(self) -> Reason:
        return self.command(Command.DO_SET_MODE, 1, Mode.MANUAL)

    def beat(self) -> None:
        self._stack.send(self._beats.key, lambda: self._beats.put(OPERATOR_BEAT))

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float = 0.0, ttl_ms: int = 300) -> None:
        self._frames += 1
        frame = Teleop(
            time_ns=0,
            seq=self._frames,
            speed_mm_s=round(1000 * speed_m_s),
            yaw_rate_mrad_s=round(1000 * yaw_rate_rad_s),
            ttl_ms=ttl_ms,
        )
        self._stack.send(self._handle.key, lambda: self._handle.put(frame))

    def upload(self, items: list[MissionItemInt]) -> MissionVerdict:
        """Run the whole transfer; return its last message."""
        first = MissionCount(count=len(items), mission_type=items[0].mission_type)
        for frame in (first, *items):
            answer = self.ask(frame, MISSION_SERVICE)
            if isinstance(answer, MissionVerdict):
                return answer
        raise AssertionError("no verdict after the last item")


def stops(*places: Place, hold_s: float = 0.0) -> list[MissionItemInt]:
    return [_item(seq, place, param1=hold_s) for seq, place in enumerate(places)]


def fence(*places: Place) -> list[MissionItemInt]:
    """Return a polygon with these corners."""
    command, kind = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, MissionType.FENCE
    count = float(len(places))
    return [
        _item(seq, place, param1=count, command=command, mission_type=kind)
        for seq, place in enumerate(places)
    ]


def _item(seq: int, place: Place, **changes: Any) -> MissionItemInt:
    fields = {
        "command": Command.SIDESTEP_NAV_POSE,
        "param2": 0.05,
        "param3": 5.0,
        "param4": nan,
    }
    x, y = (round(10_000 * metres) for metres in place)
    return MissionItemInt(seq=seq, frame=FRAME_LOCAL_FLU, x=x, y=y, z=0.0, **{**fields, **changes})


def drive_about(stack: InProcess) -> None:
    """Use every request once: goal, parameter, fence, mission, teleop; refuse a second operator."""
    ada, bob = Operator(stack, "ada"), Operator(stack, "bobby")
    stack.arm()
    ada.ask(ParamSet(param_id="v_max_m_s", param_value=0.25, param_type=9), PARAMETER)
    x_m, y_m = stack.world.start.x_m, stack.world.start.y_m
    ada.upload(fence((-1.0, -1.0), (9.0, -1.0), (9.0, 9.0), (-1.0, 9.0)))
    ada.upload(stops((x_m + 0.5, y_m), (x_m + 0.5, y_m + 0.5), hold_s=0.3))
    stack.goto_goal()
    stack.forward(2.0)
    assert ada.lease(LeaseAction.TAKE) == Reason.NONE
    assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
    assert bob.upload(stops((9.0, 9.0))).reason == Reason.LEASE_HELD
    assert ada.command(Command.MISSION_START) == Reason.NONE
    assert ada.lease(LeaseAction.RELEASE) == Reason.NONE
    stack.forward(1.0)
    ada.command(Command.DO_PAUSE_CONTINUE, 0)
    stack.forward(0.5)
    ada.command(Command.DO_PAUSE_CONTINUE, 1)
    stack.forward(5.0)
    ada.beat()
    stack.forward(0.1)
    assert ada.manual() == Reason.NONE
    for _ in range(8):
        ada.beat()
        ada.steer(-0.2, 0.7, ttl_ms=120)
        stack.forward(0.2)
    stack.inject("scan_stopped", for_s=0.5)
    stack.forward(1.0)
