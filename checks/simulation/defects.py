"""Fixed defects that can be put back, to check that the simulation finds them.

Each defect is a patch of product code in this process, with the name of the review's finding.
"""

from collections import deque
from collections.abc import Callable
from importlib import import_module
from typing import Any, Final, NamedTuple

from protocol.wire.enums import Command
from robot.core import reasons, states
from robot.file_writer import InlineWriter
from runtime.units import PERIOD_MS

Patches = dict[str, object]


class Defect(NamedTuple):
    """A defect; `patches` returns new replacements by their import paths for each run."""

    description: str
    patches: Callable[[], Patches]


def _swallowed_stop() -> Patches:
    """Count ids up, and find an answer by its id alone, for stops too."""
    from robot.commands import Commands

    act = Commands.receive
    counted = [0]
    answers: deque[tuple[object, int, object]] = deque(maxlen=1000)

    class Counting:
        @staticmethod
        def randbits(_bits: int) -> int:
            counted[0] += 1
            return counted[0]

    def receive(self: Any, request: Any, now_ms: int, operator: str = "") -> Any:
        for commands, number, answer in answers:
            if commands is self and number == request.request_id:
                return answer
        answer = act(self, request, now_ms, operator)
        answers.append((self, request.request_id, answer))
        return answer

    return {
        "robot.commands.Commands.receive": receive,
        "ground.client.requests.secrets": Counting,
        "ground.client.emergency_stop.secrets": Counting,
    }


def _queue_of_stops() -> Patches:
    """Queue 64 stops, take six per tick, and ignore known ids."""
    from robot.commands import Commands
    from robot.emergency_stop import stop_in

    known: set[int] = set()
    act = Commands.receive

    def receive(self: Any, request: Any, now_ms: int, operator: str = "") -> Any:
        known.add(request.request_id)
        return act(self, request, now_ms, operator)

    class Line:
        def __init__(self, *_: object) -> None:
            self._waiting: deque[bytes] = deque()

        def press(self, _operator: str, frame: bytes) -> None:
            if len(self._waiting) < 64:
                self._waiting.append(frame)

        def take(self) -> Any:
            for _ in range(min(6, len(self._waiting))):
                request = stop_in(self._waiting.popleft())
                if request.request_id not in known:
                    return request
            return None

    return {"robot.process.StopLatch": Line, "robot.commands.Commands.receive": receive}


def _trusting_driver() -> Patches:
    """Take a command from the future as new, and accept any time to live."""

    class Gate:
        def __init__(self) -> None:
            self._sent = 0
            self._last = (0, -1)
            self._pending: tuple[int, int, int] | None = None
            self.answered = False

        def begin_tick(self, tick: int) -> None:
            self._sent, self.answered = tick, False

        def receive(self, command: Any) -> str:
            self.answered = self.answered or command.sense_seq == self._sent
            left_ms = command.ttl_ms - max(0, (self._sent - command.sense_seq) * PERIOD_MS)
            if left_ms >= 0 and (command.sense_seq, command.seq) >= self._last:
                self._last = command.sense_seq, command.seq
                self._pending = command.left_mrad_s, command.right_mrad_s, left_ms
            return ""

        def take(self) -> Any:
            pending, self._pending = self._pending, None
            return pending

    return {"plant.robot_link.CommandGate": Gate}


def _unbounded_stamp() -> Patches:
    return {
        "protocol.bus.mailbox.MAX_STAMP_NS": 1 << 65,
        "protocol.bus.mailbox.MAX_AHEAD_NS": 1 << 65,
    }


def _age_by_arrival() -> Patches:
    """Measure the age of heartbeat and teleop from their arrival, however late they are."""

    def counts(self: Any, origin: Any, vehicle: Any) -> bool:
        return bool(origin.sender and vehicle.lease.allows(origin.sender))

    def sent_ns(self: Any, origin: Any, now_ns: int) -> int:
        return int(origin.arrived_ns)

    return {"robot.senses.Senses._is_accepted": counts, "robot.senses.Senses._sent_ns": sent_ns}


def _mission_to_auto() -> Patches:
    """Start the next item of a mission in AUTO in every mode."""

    def end(self: Any) -> int:
        machine = self._machine
        guided = machine.mode == states.GUIDED and not machine.operator
        found = int(original(self))
        return reasons.OK if guided and found == reasons.OPERATOR_LOST else found

    original = import_module("robot.mission").MissionExecutor.reason_to_end
    return {
        "robot.mission.MissionExecutor._mode": lambda self: states.AUTO,
        "robot.mission.MissionExecutor.reason_to_end": end,
    }


def _steered_after_seizure() -> Patches:
    """Check the sender of a frame when the frame arrives, not when it is read."""

    def counts(self: Any, origin: Any, vehicle: Any) -> bool:
        late = self._delays.is_late(origin.sender, origin.sent_ns or 0, origin.arrived_ns)
        return bool(origin.sender) and not late

    return {"robot.senses.Senses._is_accepted": counts}


def _content_not_synced() -> Patches:
    """Rename a file before its content is on the disk; the directory is synchronised."""

    def write(path: Any, data: bytes) -> None:
        disk = import_module("runtime.files").os
        disk.write(disk.open(path, disk.O_WRONLY | disk.O_CREAT | disk.O_TRUNC), data)

    return {"runtime.files.write": write}


def _fence_inside_out() -> Patches:
    fences, failsafe = (
        import_module("robot.core.safety.fence"),
        import_module("robot.core.safety.failsafe"),
    )

    def breached(state: Any, inputs: Any, params: Any) -> bool:
        fence, pose = state.machine.fence, state.odometry.pose
        return fence is not None and bool(fences.inside(fence, pose.x_m, pose.y_m))

    return {
        "robot.core.safety.failsafe.TRIGGERS": tuple(
            (breached, row) if trigger is failsafe.fence_breached else (trigger, row)
            for trigger, row in failsafe.TRIGGERS
        )
    }


def _fence_forgotten() -> Patches:
    arm = import_module("robot.core.modes").arm

    def armed(machine: Any) -> int:
        machine.fence_unreadable = False
        return int(arm(machine))

    return {"robot.core.modes.arm": armed}


def _weakened() -> Patches:
    return {
        "robot.parameter_service.ParameterService._unsafe": lambda self, name, value: reasons.OK
    }


def _stop_waits_for_a_tick() -> Patches:
    """Read the latch at a tick only, not between two ticks."""

    def idle(self: Any) -> None:
        now_ns = self._clock.now_ns()
        self._saved.settle(now_ns)
        self._answer()
        self.reports.events(self.vehicle, self._senses.stamp_ns, now_ns)

    return {"robot.process.RobotProcess.idle": idle}


def _old_ticks() -> Patches:
    """Take commands that answer a tick 3 x as old, and let them last as long as new ones."""
    gate = import_module("plant.robot_link")
    move = gate.CommandGate._move

    def moved(self: Any, command: Any, tick: int) -> str:
        before, self._pending = self._pending, None
        why = str(move(self, command, tick))
        if self._pending not in (None, gate.STOPPED):
            *speeds, _ = self._pending
            self._pending = (*speeds, gate.ends_ms(command, self._ticks[-1]))
        self._pending = self._pending or before
        return why

    return {
        "plant.robot_link.WINDOW": 3 * gate.MAX_AGE_TICKS + 1,
        "plant.robot_link.CommandGate._move": moved,
    }


def _missions_for_all() -> Patches:
    """Let every operator start the mission."""
    original = import_module("robot.commands").needs_no_lease

    def needs_no_lease(request: Any) -> bool:
        starts = getattr(request, "command", None) == Command.MISSION_START
        return starts or bool(original(request))

    return {"robot.vehicle.needs_no_lease": needs_no_lease}


def _overtaken_clear() -> Patches:
    """Obey a request to clear the stop that had arrived before the stop."""
    original = import_module("robot.process").RobotProcess._rejection

    def rejection(self: Any, incoming: Any) -> int:
        found = int(original(self, incoming))
        return reasons.OK if found == reasons.NEWER_STOP else found

    return {"robot.process.RobotProcess._rejection": rejection}


def _any_program_drives() -> Patches:
    """Let a drive go on while any program of the person is there."""
    age_ms = import_module("robot.vehicle").RobotVehicle._age_ms
    return {
        "robot.vehicle.RobotVehicle.operator_age_ms": lambda self, now_ns: age_ms(self, "", now_ns)
    }


def _any_program_steers() -> Patches:
    """Take teleop frames of every program of the person."""
    original = import_module("robot.vehicle").RobotVehicle.receive_teleop

    def receive_teleop(self: Any, teleop: Any, sent_ns: int, _operator: str) -> None:
        original(self, teleop, sent_ns, self.commands.driver)

    return {"robot.vehicle.RobotVehicle.receive_teleop": receive_teleop}


def _stops_need_the_lease() -> Patches:
    """Refuse hold, abort and disarm without the lease."""
    commands = import_module("robot.commands")

    def needs_no_lease(request: Any) -> bool:
        is_read = isinstance(request, commands.READ_ONLY)
        return is_read or bool(commands.kind_of(request).is_emergency_stop)

    return {"robot.vehicle.needs_no_lease": needs_no_lease}


def _wide_circle() -> Patches:
    """Take a circle as 1 m wider than it is."""
    fences = import_module("robot.core.safety.fence")
    original = fences.inside

    def inside(fence: Any, x_m: float, y_m: float) -> bool:
        wide = fence._replace(radius_m=fence.radius_m + 1.0) if fence.radius_m else fence
        return bool(original(wide, x_m, y_m))

    return {"robot.core.safety.fence.inside": inside}


def _shared_control() -> Patches:
    """Let every client command under the lease of the one in control."""
    return {
        "gateways.mavlink.operator_control.OperatorControl.holds": lambda self, _sender: (
            self.owner is not None
        )
    }


def _stop_in_the_queue() -> Patches:
    """Let an emergency stop wait behind the other requests to the robot."""
    port = import_module("gateways.mavlink.bus_port")

    def stop(self: Any) -> Any:
        waiting = self._new_stop()

        def job() -> Any:
            return port.in_own_thread(lambda: port.Stopped(waiting.run(), self.name), "stop")

        asked = self._request(job, "", is_tried=True, expires=False)
        return port.StopPress(waiting.request_id, asked)

    return {"gateways.mavlink.bus_port.BusPort.stop": stop}


def _strangers_command() -> Patches:
    """Take unsigned frames from other machines as well."""
    rights = import_module("gateways.mavlink.signing").Rights.COMMAND
    return {"gateways.mavlink.signing.rights_of": lambda *_, is_loopback: rights}


DEFECTS: Final[dict[str, Defect]] = {
    "A1": Defect("an answer is found by its id alone, for stops too", _swallowed_stop),
    "A2": Defect("emergency stops wait in a queue", _queue_of_stops),
    "A3": Defect("the motor driver trusts the frame", _trusting_driver),
    "A4": Defect("stamps are not bounded", _unbounded_stamp),
    "A7a": Defect("heartbeat and teleop are aged from their arrival", _age_by_arrival),
    "A7b": Defect(
        "requests have no deadline",
        lambda: {"robot.process.RobotProcess._rejection": lambda self, asked: reasons.OK},
    ),
    "A8": Defect("a mission continues in AUTO", _mission_to_auto),
    "A9": Defect(
        "the control loop writes to the disk",
        lambda: {"checks.simulation.hosts.robot_and_plant.WriterThread": InlineWriter},
    ),
    "A12": Defect("teleop continues after the lease is seized", _steered_after_seizure),
    "A13a": Defect(
        "a directory is not synchronised", lambda: {"runtime.files.sync_folder": lambda path: None}
    ),
    "A13b": Defect("a file is renamed before it is synchronised", _content_not_synced),
    "A13c": Defect("a robot with an unreadable fence is armed", _fence_forgotten),
    "A14": Defect("failsafes can be weakened from the ground", _weakened),
    "D-fence": Defect("the fence's failsafe is inverted", _fence_inside_out),
    "early": Defect(
        "a change is acknowledged before it is saved",
        lambda: {"robot.vehicle.RobotVehicle.saving": lambda self, request, answer: None},
    ),
    "d1": Defect("the latch is not read between two ticks in lockstep", _stop_waits_for_a_tick),
    "d2": Defect("old ticks are answered, and the answers last", _old_ticks),
    "d3": Defect("a mission is started without the lease", _missions_for_all),
    "d4": Defect("a clear that came before the stop is obeyed", _overtaken_clear),
    "d5": Defect(
        "teleop is not dropped when the lease is seized",
        lambda: {"robot.commands.TeleopInput.clear": lambda self: None},
    ),
    "d6": Defect("a circle fence is 1 m too wide", _wide_circle),
    "d7": Defect("any program of the person keeps a drive going", _any_program_drives),
    "d8": Defect("any program of the person steers", _any_program_steers),
    "d9": Defect("what stops the robot needs the lease", _stops_need_the_lease),
    "d10": Defect(
        "a lease does not end with its person", lambda: {"robot.lease.LAPSE_NS": 1 << 62}
    ),
    "ids": Defect(
        "a session whose id is taken is never replaced",
        lambda: {"protocol.bus.session.LastingSession.replace": lambda self, before, **_: False},
    ),
    "kept": Defect(
        "the kept stop is not looked for at the start",
        lambda: {"robot.emergency_stop.KeptStop.found": lambda self: False},
    ),
    "g1": Defect("the gateway obeys every client once one is in control", _shared_control),
    "g2": Defect("a stop waits in the gateway behind other requests", _stop_in_the_queue),
    "g3": Defect(
        "a client in control is never too silent",
        lambda: {"gateways.mavlink.operator_control.SILENCE_NS": 1 << 62},
    ),
    "g4": Defect("the gateway obeys unsigned frames of other machines", _strangers_command),
    "unkept": Defect(
        "the stop is not written to the disk",
        lambda: {"robot.emergency_stop.KeptStop.keep": lambda self, *, stopped: None},
    ),
}
