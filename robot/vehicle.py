"""All that is onboard but the clock and the sockets: core, commands, parameters, what to tell."""

import json
from math import nan
from typing import Final, TypeAlias

from protocol.enums import PARAM_TYPE_INT32, PARAM_TYPE_REAL32, Severity
from protocol.message import Message
from protocol.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    Heartbeat,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Statustext,
)
from robot import telemetry
from robot.commands import Commands, result_of
from robot.core import brain, failsafe, modes, reasons, states
from robot.core.brain import Mark
from robot.core.parameters import Params
from robot.core.state import State
from robot.core.values import Inputs, Outputs, Pose
from robot.news import News
from robot.parameters import SPECS, TABLE, OutOfRange, Unknown, described, with_value
from robot.store import Store

Answer: TypeAlias = CommandAck | ParamValue

MOST_TEXTS: Final = 100  # kept while nobody listens
HEARTBEAT_NS: Final = 200_000_000
NS_PER_MS: Final = 1_000_000
ORIGIN: Final = Pose(0.0, 0.0, 0.0)


class Vehicle:
    """Sans-I/O: requests and senses in, answers, wheel speeds and texts out; time is passed in."""

    def __init__(self, params: Params, store: Store, start: Pose = ORIGIN) -> None:
        self.params = params
        self.state = State(params)
        self.state.odometry.pose = start
        self.commands = Commands(self.state)
        self._store = store
        self._news = News(self.state.machine)
        self._texts = self._news.text(Severity.INFO, "started: disarmed, standing still")
        self._operator_ns: int | None = None
        self._beat: tuple[int, int, int] | None = None
        self._beat_due_ns = 0
        self._slipping = False

    @property
    def zone_m(self) -> float:
        """Width of the avoidance zone of the navigator in use; NaN where it has none."""
        zones_m = {states.BUG: self.params.d_th_m, states.VGM: self.params.d_obs_m}
        return zones_m.get(self.state.machine.navigator, nan)

    def described(self) -> bytes:
        """All parameters as JSON; `saved`: this value is still there after a restart."""
        rows = [
            row | {"saved": self._store.holds(str(row["name"]), float(row["value"]))}
            for row in described(self.params)
        ]
        return json.dumps(rows).encode()

    def hear_operator(self, now_ns: int) -> None:
        """An operator's heartbeat has arrived."""
        self._operator_ns = now_ns

    def operator_age_ms(self, now_ns: int) -> int | None:
        return None if self._operator_ns is None else (now_ns - self._operator_ns) // NS_PER_MS

    def receive(self, request: Message, now_ns: int) -> Answer:
        """Act on a request and answer it; a refusal is a COMMAND_ACK with its reason."""
        if isinstance(request, ParamSet):
            return self._set(request)
        if isinstance(request, ParamRequestRead):
            return self._read(request)
        if isinstance(request, CommandRequest | GoalRequest):
            return self.commands.receive(request, now_ns // NS_PER_MS)
        return refusal(reasons.UNKNOWN_COMMAND)

    def step(self, inputs: Inputs, mark: Mark) -> Outputs:
        """One tick of the core. An exception leaves the vehicle in FAILSAFE and goes on upwards."""
        try:
            _, outputs = brain.step(self.state, inputs, self.params, mark)
        except Exception:
            failsafe.trip(self.state.machine, reasons.CORE_EXCEPTION, inputs.now_ms)
            raise
        slipping = self.state.slip.share > 0.0
        if slipping and not self._slipping:
            self.say(Severity.WARNING, "wheels seem to slip: place less sure")
        self._slipping = slipping
        return outputs

    def report(self, reason: int) -> None:
        """A failsafe reason that only the host can see; the next step acts on it."""
        self.state.reported = reason

    def stop(self, reason: int, now_ns: int) -> None:
        """The host ends: no goal survives it; a failsafe that is on keeps its own reason."""
        if self.state.machine.vehicle == states.ACTIVE:
            failsafe.trip(self.state.machine, reason, now_ns // NS_PER_MS)

    def say(self, severity: int, words: str) -> None:
        self._texts = (self._texts + self._news.text(severity, words))[-MOST_TEXTS:]

    def texts(self) -> list[Statustext]:
        """What is to be told now, oldest first."""
        texts = self._texts + self._news.since_last_time()
        self._texts = []
        return texts

    def heartbeat(self, now_ns: int) -> Heartbeat | None:
        """Due five times a second, and at once when vehicle or mode has changed."""
        machine = self.state.machine
        beat = (machine.vehicle, machine.mode, machine.vehicle_reason)
        if beat == self._beat and now_ns < self._beat_due_ns:
            return None
        self._beat = beat
        self._beat_due_ns = now_ns + HEARTBEAT_NS
        return telemetry.heartbeat(self.state)

    def _set(self, request: ParamSet) -> Answer:
        value = float(f"{request.param_value:.7g}")  # float32 carries seven digits: 0.1 is 0.1
        try:
            params = with_value(self.params, request.param_id, value)
        except Unknown:
            return refusal(reasons.UNKNOWN_PARAMETER)
        except OutOfRange:
            return refusal(reasons.PARAMETER_OUT_OF_RANGE)
        reason = self._adopt(params)
        if reason != reasons.OK:
            return refusal(reason)
        try:
            self._store.save(request.param_id, float(getattr(params, request.param_id)))
        except OSError as error:
            self.say(Severity.ERROR, f"{request.param_id} not saved: {error.strerror}")
            return refusal(reasons.NOT_SAVED)
        return self._value(request.param_id)

    def _adopt(self, params: Params) -> int:
        """Put parameters into force; navigator and side are the mode machine's to refuse."""
        machine = self.state.machine
        if (params.navigator, params.side) != (self.params.navigator, self.params.side):
            reason = modes.set_navigator(machine, params.navigator, params.side)
            if reason != reasons.OK:
                return reason
        machine.goal_max_m = params.goal_max_m
        self.params = params
        return reasons.OK

    def _read(self, request: ParamRequestRead) -> Answer:
        name = request.param_id
        if 0 <= request.param_index < len(TABLE):
            name = TABLE[request.param_index].name
        return self._value(name) if name in SPECS else refusal(reasons.UNKNOWN_PARAMETER)

    def _value(self, name: str) -> ParamValue:
        spec = SPECS[name]
        return ParamValue(
            param_id=name,
            param_value=float(getattr(self.params, name)),
            param_type=PARAM_TYPE_INT32 if spec.integer else PARAM_TYPE_REAL32,
            param_count=len(TABLE),
            param_index=TABLE.index(spec),
        )


def refusal(reason: int) -> CommandAck:
    """What answers a parameter request that was not granted."""
    return CommandAck(
        command=0,
        result=result_of(reason),
        progress=0,
        result_param2=reason,
        target_system=0,
        target_component=0,
    )
