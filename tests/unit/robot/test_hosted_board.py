"""A core on a board does what one in the process does; a failing board ends the robot."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import inf, nan
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec import structs

from checks.harness.messages import make
from firmware.board import RESTART, Board, BoardError, BoardMismatchError, SerialLine
from firmware.host import WALL_TIME, BoardCore
from firmware.image import core_hash, core_version
from plant.model.configuration import noise_of
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.wire.enums import (
    FRAME_LOCAL_FLU,
    PARAM_TYPE_REAL32,
    Command,
    MissionState,
    MissionType,
    Mode,
    Navigator,
)
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.message import Message, wire_of
from protocol.wire.messages import (
    BoardRestart,
    CommandRequest,
    GoalRequest,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    ParamSet,
    Teleop,
)
from robot import telemetry
from robot.commands import operator_twist
from robot.core import reasons, states
from robot.core.brain import ignore
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Inputs, Pose, Scan, Wheels, now_ms_of, scan_of, wheels_of
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.errors import UserError
from tests.support import hosted_loop
from tests.support.each import each

PATIENCE_S = 20.0


class Hosted:
    """A running hosted board; `line` is the host's end of its serial line."""

    def __init__(self, which: str = "") -> None:
        ours, theirs = socket.socketpair()
        descriptor = ours.detach()
        self.line = SerialLine(descriptor, os.dup(descriptor), self._is_alive)
        words = [sys.executable, "-m", hosted_loop.__name__, str(theirs.fileno()), which]
        self._process = subprocess.Popen(words, pass_fds=[theirs.fileno()])
        theirs.close()

    def _is_alive(self) -> bool:
        return self._process.poll() is None

    def suspend(self) -> None:
        """Stop the board without ending it."""
        self._process.send_signal(signal.SIGSTOP)

    def kill(self) -> None:
        """End the board and wait for its end."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End the board."""
        self.line.close()
        self._process.kill()
        self._process.wait()


@contextmanager
def hosted_board(patience_s: float = PATIENCE_S, which: str = "") -> Iterator[tuple[Board, Hosted]]:
    """Return a board that has said hello, and its process."""
    hosted = Hosted(which)
    try:
        board = Board(hosted.line, patience_s)
        board.wait_for_hello()
        yield board, hosted
    finally:
        hosted.close()


PARAMS = DEFAULTS._replace(v_max_m_s=0.25, progress_ms=60_000)
COMMANDS = (
    (Command.COMPONENT_ARM_DISARM, (1.0, 0.0)),
    (Command.DO_SET_MODE, (states.MANUAL, states.HOLD, states.AUTO, states.GUIDED, 77)),
    (Command.DO_PAUSE_CONTINUE, (0.0, 1.0)),
    (Command.DO_FLIGHTTERMINATION, (1.0,)),
    (Command.SIDESTEP_CLEAR_EMERGENCY_STOP, (0.0,)),
    (Command.NAV_RETURN_TO_LAUNCH, (0.0,)),
    (Command.SIDESTEP_ABORT_GOAL, (0.0,)),
    (Command.SIDESTEP_SET_NAVIGATOR, tuple(map(float, Navigator))),
    (Command.MISSION_START, (-1.0, 0.0, 1.0)),
    (Command.DO_SET_MISSION_CURRENT, (0.0, 1.0, 9.0)),
    (31_000, (0.0,)),
)


class Twins:
    """Two vehicles with the same plant; every observation must be the same, to the bit."""

    def __init__(self, new_core: Callable[..., BoardCore], seed: int) -> None:
        self.random = Random(seed)
        world = load("box")
        self.plant = Plant(world, seed, noise_of(world, "default"))
        start = Pose(world.start.x_m, world.start.y_m, world.start.heading_rad)
        self.vehicles = (
            RobotVehicle(PARAMS, Store(None), start),
            RobotVehicle(PARAMS, Store(None), start, new_core=new_core),
        )
        self.requests = 0

    @property
    def now_ns(self) -> int:
        return self.plant.now_ns

    def same(self, ask: Callable[[RobotVehicle], Any]) -> Any:
        """Ask both and require the same answer."""
        here, board = map(ask, self.vehicles)
        assert on_the_wire(here) == on_the_wire(board)
        return here

    def request(self, message: Message) -> Any:
        answer = self.same(lambda vehicle: vehicle.receive(message, self.now_ns, "ada/1"))
        self.observe()
        return answer

    def command(self, command: int, *values: float) -> int:
        self.requests += 1
        one, two, three = (*values, 0.0, 0.0, 0.0)[:3]
        if command == Command.DO_SET_MODE:
            one, two = 1.0, one
        request = CommandRequest(
            request_id=self.requests, param1=one, param2=two, param3=three, command=command
        )
        reason: int = self.request(request).result_param2
        return reason

    def goto(self, x_m: float, y_m: float, mode: int = Mode.AUTO, *, free: int = 1) -> int:
        self.requests += 1
        request = GoalRequest(
            request_id=self.requests,
            x_mm=round(x_m * 1000),
            y_mm=round(y_m * 1000),
            heading_urad=1_234_567,
            position_tolerance_mm=50,
            heading_tolerance_urad=52_360,
            heading_free=free,
            mode=mode,
        )
        reason: int = self.request(request).result_param2
        return reason

    def set(self, name: str, value: float) -> None:
        self.request(
            ParamSet(
                param_id=name,
                param_value=value,
                param_type=PARAM_TYPE_REAL32,
                target_system=0,
                target_component=0,
            )
        )

    def upload(self, kind: int, *items: MissionItemInt) -> int:
        self.request(MissionCount(count=len(items), mission_type=kind))
        for item in items:
            verdict = self.request(item)
        reason: int = verdict.reason
        return reason

    def tick(self, *, wheels: bool = True, scan: bool = True, steered: bool = False) -> None:
        """Run a tick of the plant and of both vehicles."""
        self.plant.advance()
        ticks, echoes = self.plant.senses()
        now_ms = now_ms_of(self.now_ns)
        teleop = None
        if steered:
            teleop = Teleop(time_ns=0, seq=0, speed_mm_s=150, yaw_rate_mrad_s=-300, ttl_ms=200)
        inputs = Inputs(
            now_ms,
            wheels_of(ticks) if wheels and ticks is not None else None,
            scan_of(echoes, 7) if scan and echoes is not None else None,
            0 if self.random.random() < 0.9 else None,
        )
        outputs = self.same(lambda one: one.step(inputs, ignore, operator_twist(teleop)))
        self.same(lambda one: telemetry.odometry(one.state, self.now_ns))
        self.plant.command(0, outputs.left_mrad_s, outputs.right_mrad_s, MAX_WHEEL_TTL_MS)
        self.observe()

    def observe(self) -> None:
        """Compare everything that is published."""
        now_ns, now_ms = self.now_ns, now_ms_of(self.now_ns)
        self.same(lambda one: telemetry.heartbeat(one.state))
        self.same(lambda one: telemetry.status(one.state, one.commands.goal_id, now_ns, now_ms))
        self.same(lambda one: one.mission.status(now_ns))
        self.same(lambda one: one.texts())
        self.same(lambda one: one.parameters.describe())
        self.same(lambda one: (one.brakes, one.stopped, one.params, one.state.odometry.pose))


def on_the_wire(found: Any) -> Any:
    """Return messages as bytes, and the decision of a tick with the precision of the wire."""
    if isinstance(found, Message):
        return type(found), wire_of(type(found)).pack(found)
    if isinstance(found, list):
        return [on_the_wire(one) for one in found]
    if hasattr(found, "decision"):
        decided = on_the_wire(telemetry.decision(found, nan, 0))
        return found.left_mrad_s, found.right_mrad_s, found.guard, decided
    return found


def stop_at(seq: int, x_m: float, y_m: float, deg: float = nan) -> MissionItemInt:
    return MissionItemInt(
        param1=0.2, param2=0.05, param3=3.0, param4=deg, x=round(x_m * 10_000),
        y=round(y_m * 10_000), z=0.0, seq=seq, command=Command.SIDESTEP_NAV_POSE,
        target_system=0, target_component=0, frame=FRAME_LOCAL_FLU, current=0, autocontinue=1,
        mission_type=MissionType.MISSION,
    )  # fmt: skip


def corner(seq: int, x_m: float, y_m: float) -> MissionItemInt:
    return make(
        MissionItemInt, param1=4.0, x=round(x_m * 10_000), y=round(y_m * 10_000), seq=seq,
        command=Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, target_system=0, target_component=0,
        frame=FRAME_LOCAL_FLU, current=0, autocontinue=1, mission_type=MissionType.FENCE,
    )  # fmt: skip


SQUARE = (corner(0, 0.0, 0.0), corner(1, 6.0, 0.0), corner(2, 6.0, 4.0), corner(3, 0.0, 4.0))


@contextmanager
def twins(seed: int) -> Iterator[Twins]:
    with hosted_board() as (board, _):
        yield Twins(partial(BoardCore, board), seed)


def step(both: Twins) -> None:
    """Take a random step: mostly ticks, else a request or a fault."""
    random = both.random
    match random.choices(range(9), (40, 8, 4, 2, 2, 2, 1, 1, 1))[0]:
        case 0:
            steered = random.random() < 0.5
            for _ in range(random.randrange(1, 12)):
                both.tick(steered=steered)
        case 1:
            command, values = random.choice(COMMANDS)
            both.command(command, random.choice(values))
        case 2:
            mode = random.choice((Mode.AUTO, Mode.GUIDED, Mode.MANUAL))
            both.goto(random.uniform(-1.0, 7.0), random.uniform(0.0, 4.0), mode, free=0)
        case 3:
            name = random.choice(("d_obs_m", "side", "navigator", "goal_max_m", "stuck_ms", "x"))
            both.set(name, random.choice((-1.0, 0.4, 3.0, 9e9)))
        case 4:
            both.upload(MissionType.MISSION, stop_at(0, 2.0, 1.0), stop_at(1, 2.5, 3.0, 90.0))
        case 5:
            both.command(Command.SIDESTEP_SET_POSE, 1.0, 2.0, random.choice((nan, 0.5)))
        case 6:
            both.same(lambda one: one.lose_position(both.now_ns))
            both.observe()
        case 7:
            both.same(lambda one: one.core.report(reasons.BUDGET))
            both.tick()
        case _:
            both.tick(wheels=random.random() < 0.5, scan=random.random() < 0.5)


@pytest.mark.sweep(5)
@pytest.mark.parametrize(("seed", "rounds"), [(0, 12), *((seed, 30) for seed in range(4))])
def test_random_drives_are_equal_to_the_bit(seed: int, rounds: int) -> None:
    with twins(seed) as both:
        both.tick()
        for _ in range(rounds):
            both.command(Command.COMPONENT_ARM_DISARM, 1.0)
            for _ in range(6):
                step(both)


def test_fence_is_equal_to_the_bit() -> None:
    with twins(1) as both:
        both.tick()
        assert both.upload(MissionType.FENCE, *SQUARE) == reasons.OK
        assert both.command(Command.COMPONENT_ARM_DISARM, 1.0) == reasons.OK
        assert both.goto(7.0, 2.0) == reasons.OUTSIDE_FENCE
        assert both.goto(4.0, 2.0) == reasons.OK
        for _ in range(40):
            both.tick()
        assert both.command(Command.NAV_RETURN_TO_LAUNCH) == reasons.OK
        assert both.upload(MissionType.FENCE, *(corner(n, 9.0 + n % 2, n) for n in range(4))) > 0
        for _ in range(20):
            both.tick()
        both.request(MissionClearAll(mission_type=MissionType.FENCE))
        assert both.goto(7.0, 2.0) == reasons.OK


def test_exclusion_is_equal_to_the_bit() -> None:
    places = ((3, 1), (4, 1), (4, 3), (3, 3))
    hole = [
        structs.replace(corner(at, *place), command=Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
        for at, place in enumerate(places, start=4)
    ]
    folded = [hole[0], *(structs.replace(one, x=40_000) for one in hole[1:])]
    with twins(1) as both:
        both.tick()
        assert both.upload(MissionType.FENCE, *SQUARE, *hole) == reasons.OK
        assert both.upload(MissionType.FENCE, *SQUARE, *folded) == reasons.FENCE_NOT_SIMPLE
        assert both.command(Command.COMPONENT_ARM_DISARM, 1.0) == reasons.OK
        assert both.goto(3.5, 2.0) == reasons.OUTSIDE_FENCE
        assert both.goto(5.0, 2.0) == reasons.OK
        while both.vehicles[0].state.machine.vehicle == states.ACTIVE:
            both.tick()
        assert both.vehicles[0].state.machine.vehicle_reason == reasons.FENCE_BREACHED
        assert both.upload(MissionType.FENCE, *SQUARE) == reasons.OK
        both.tick()
        assert both.command(Command.COMPONENT_ARM_DISARM, 1.0) == reasons.OK


def test_lost_fence_forbids_arming_on_the_board() -> None:
    with twins(2) as both:
        both.same(lambda one: one.core.lose_fence())
        both.observe()
        both.tick()
        assert both.command(Command.COMPONENT_ARM_DISARM, 1.0) == reasons.FENCE_UNREADABLE


def test_speed_wait_and_return_of_a_mission_are_equal_to_the_bit() -> None:
    def order(seq: int, command: int, param1: float, param2: float = 0.0) -> MissionItemInt:
        facts = {"frame": 2, "command": command, "param1": param1, "param2": param2}
        return structs.replace(stop_at(seq, 0.0, 0.0), **facts)

    with twins(3) as both:
        both.tick()
        slow = order(0, Command.DO_CHANGE_SPEED, 1.0, 0.1)
        wait, back = order(2, Command.NAV_DELAY, 0.5), order(4, Command.NAV_RETURN_TO_LAUNCH, 0.0)
        jump = order(3, Command.DO_JUMP, 2.0, 1.0)
        steps = (slow, stop_at(1, 1.5, 2.2), wait, jump, back)
        assert both.upload(MissionType.MISSION, *steps) == reasons.OK
        both.command(Command.COMPONENT_ARM_DISARM, 1.0)
        assert both.command(Command.MISSION_START) == reasons.OK
        for tick in range(1400):
            both.tick()
            if tick == 20:
                both.set("v_max_m_s", 0.2)
            if not both.vehicles[0].mission.active:
                break
        assert both.vehicles[0].mission.state == MissionState.DONE


def test_mission_continues_and_jumps_on_the_board() -> None:
    with twins(3) as both:
        both.tick()
        both.upload(MissionType.MISSION, stop_at(0, 1.5, 2.2), stop_at(1, 2.2, 2.9, 90.0))
        both.command(Command.COMPONENT_ARM_DISARM, 1.0)
        assert both.command(Command.MISSION_START, -1.0) == reasons.OK
        for _ in range(30):
            both.tick()
        assert both.command(Command.DO_PAUSE_CONTINUE, 0.0) == reasons.OK
        both.tick()
        assert both.command(Command.DO_SET_MISSION_CURRENT, 1.0) == reasons.OK
        both.tick()
        assert both.command(Command.DO_PAUSE_CONTINUE, 1.0) == reasons.OK
        for _ in range(300):
            both.tick()
        assert both.vehicles[1].mission.current == 1
        assert both.same(lambda one: one.state.machine.goal_state) in (states.REACHED,)


def test_host_stops_the_board_for_a_reason() -> None:
    with twins(4) as both:
        both.tick()
        both.command(Command.COMPONENT_ARM_DISARM, 1.0)
        both.goto(4.0, 2.0)
        both.tick()
        both.same(lambda one: one.stop(reasons.SHUT_DOWN, both.now_ns))
        both.observe()
        assert both.vehicles[1].state.machine.vehicle_reason == reasons.SHUT_DOWN
        assert both.vehicles[1].brakes
        assert inf > both.vehicles[1].state.goal_distance_m


OPEN_SPACE = Scan((0,) * 8, (25, 0) * 4, 0xFF, 0)
ARM = CommandRequest(request_id=1, param1=1.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM)


@contextmanager
def driving(patience_s: float = 2.0) -> Iterator[tuple[RobotVehicle, Board, Hosted]]:
    """Return an armed robot on its way, with its board."""
    with hosted_board() as (board, hosted):
        vehicle = RobotVehicle(
            DEFAULTS, Store(None), new_core=lambda *given: BoardCore(board, *given)
        )
        tick(vehicle, 1)
        assert vehicle.core.command(ARM, 0) == reasons.OK
        board.patience_s = patience_s
        yield vehicle, board, hosted


def tick(vehicle: RobotVehicle, number: int) -> None:
    wheels = Wheels(0, 0, 0, 50 * number)
    vehicle.step(Inputs(50 * number, wheels, OPEN_SPACE, 0), ignore)


def fails(vehicle: RobotVehicle, words: str) -> None:
    """Require the next tick to fail with these words, and the vehicle to be stopped."""
    assert vehicle.state.machine.vehicle == states.ACTIVE
    with pytest.raises(BoardError, match=words):
        tick(vehicle, 2)
    machine = vehicle.state.machine
    assert (machine.vehicle, machine.vehicle_reason) == (states.FAILSAFE, reasons.CORE_EXCEPTION)
    assert vehicle.brakes


def test_board_that_hangs_stops_the_robot_within_the_limit() -> None:
    with driving(patience_s=0.3) as (vehicle, _, hosted):
        hosted.suspend()
        fails(vehicle, "the board hangs or its line is stuck: no answer for 0.3 s")


def test_board_that_ends_stops_the_robot_at_once() -> None:
    with driving() as (vehicle, _, hosted):
        hosted.kill()
        fails(vehicle, "the line to the board is (cut|broken)")


def test_board_that_restarts_stops_the_robot_and_names_the_cause() -> None:
    with driving(patience_s=20.0) as (vehicle, board, _):
        board.send(BoardRestart(confirmation=RESTART))
        fails(vehicle, "the board has restarted .cause: external.")


def test_restart_without_its_confirmation_is_ignored() -> None:
    with driving(patience_s=20.0) as (vehicle, board, _):
        board.send(BoardRestart(confirmation=RESTART + 1))
        tick(vehicle, 2)
        assert vehicle.state.machine.vehicle == states.ACTIVE


def test_garbage_on_the_line_changes_nothing() -> None:
    with driving(patience_s=20.0) as (vehicle, board, _):
        for number in range(2, 40):
            board.write(os.urandom(50) + b"\xfd\xff\x00")
            tick(vehicle, number)
        status = vehicle.core.board_status(0)
        assert status is not None
        assert status.skipped_bytes >= 38 * 50
        assert vehicle.state.machine.vehicle == states.ACTIVE


def test_failed_board_also_fails_a_request() -> None:
    with driving(patience_s=0.3) as (vehicle, _, hosted):
        hosted.suspend()
        with pytest.raises(BoardError, match="hangs"):
            vehicle.receive(ARM, 0)


def test_vehicle_stops_for_a_reason_without_its_board() -> None:
    with driving(patience_s=0.3) as (vehicle, _, hosted):
        hosted.kill()
        vehicle.stop(reasons.CORE_EXCEPTION, 60)
        machine = vehicle.state.machine
        assert (machine.vehicle, machine.vehicle_reason) == (
            states.FAILSAFE,
            reasons.CORE_EXCEPTION,
        )
        assert vehicle.brakes


def test_late_answer_in_wall_time_is_a_missed_deadline() -> None:
    with driving(patience_s=WALL_TIME.answer_s) as (vehicle, _, hosted):
        hosted.suspend()
        fails(vehicle, "no answer for 0.045 s")


def test_image_of_another_core_is_refused_by_name_and_hash() -> None:
    with (
        pytest.raises(BoardMismatchError) as refused,
        hosted_board(which="other-core"),
    ):
        pass
    for words in (core_version(), core_hash().hex()[:12], "000000000000", "make firmware"):
        assert words in str(refused.value)
    assert refused.value.exit_code == 2


@each(
    ("params", "name"),
    [
        (DEFAULTS._replace(stuck_ms=2**31), "stuck_ms"),
        (DEFAULTS._replace(goal_max_m=float("nan")), "goal_max_m"),
    ],
)
def test_parameter_that_does_not_fit_the_board_is_refused(params: Params, name: str) -> None:
    with (
        hosted_board() as (board, _),
        pytest.raises(UserError, match=f"the board refuses {name}: "),
    ):
        BoardCore(board, params)


def test_refused_parameters_leave_the_others_as_they_were() -> None:
    with hosted_board() as (board, _):
        core = BoardCore(board, DEFAULTS)
        changed = DEFAULTS._replace(goal_max_m=9.0, progress_ms=2**31)
        assert core.adopt(changed) == reasons.PARAMETER_OUT_OF_RANGE
        assert core.params == DEFAULTS
        assert core.state.machine.goal_max_m == DEFAULTS.goal_max_m
        assert core.adopt(DEFAULTS._replace(goal_max_m=9.0)) == reasons.OK
        assert core.params.goal_max_m == core.state.machine.goal_max_m == 9.0


def test_missing_emulator_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UserError, match="qemu-system-arm") as refused, Board.emulated():
        pass
    assert refused.value.exit_code == 2


def test_missing_image_is_a_clear_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("firmware.board.shutil.which", lambda _: "/usr/bin/qemu")
    with pytest.raises(UserError, match="make firmware"), Board.emulated(tmp_path / "none.elf"):
        pass
