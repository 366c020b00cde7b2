"""Read, set, check and save the parameters in force."""

import json

from protocol.wire.enums import PARAM_TYPE_INT32, PARAM_TYPE_REAL32
from protocol.wire.messages import CommandAck, ParamRequestRead, ParamSet, ParamValue
from robot.commands import ack
from robot.core import reasons, states
from robot.core.parameters import Params
from robot.hosting import Core
from robot.parameter_table import (
    ROUNDING,
    SPECS,
    TABLE,
    OutOfRangeError,
    UnknownParameterError,
    described,
    is_less_safe,
    with_value,
    with_values,
)
from robot.storage import Store


class ParameterService:
    """The parameters in force, those of `core`, which are replaced as a whole.

    `configured` bounds the safety group; None disables this check.
    """

    def __init__(self, core: Core, store: Store, configured: Params | None) -> None:
        self.configured = configured
        self._core = core
        self._store = store
        self._machine = core.state.machine
        self._text = b""

    @property
    def params(self) -> Params:
        """The parameters in force."""
        return self._core.params

    def forget_text(self) -> None:
        """Discard the cached list, because values or saved values have changed."""
        self._text = b""

    def describe(self) -> bytes:
        """Return all parameters as JSON; `saved` means that a restart restores the value.

        The text is cached, so that frequent requests do not load the control loop.
        """
        if not self._text:
            rows = [
                row | {"saved": self._store.holds(str(row["name"]), float(row["value"]))}
                for row in described(self.params, self.configured)
            ]
            self._text = json.dumps(rows).encode()
        return self._text

    def set(self, request: ParamSet) -> CommandAck | ParamValue:
        """Set a parameter; return its new value, or a refusal."""
        self.forget_text()
        value = float(f"{request.param_value:.7g}")  # float32 has seven digits: restore 0.1
        try:
            params = with_value(self.params, request.param_id, value)
        except UnknownParameterError:
            return ack(reasons.UNKNOWN_PARAMETER)
        except OutOfRangeError:
            return ack(reasons.PARAMETER_OUT_OF_RANGE)
        reason = self._unsafe(request.param_id, value) or self._core.adopt(params)
        if reason != reasons.OK:
            return ack(reason)
        self._store.save(request.param_id, float(getattr(params, request.param_id)))
        return self._value(request.param_id)

    def adopt_navigator(self) -> None:
        """Adopt navigator and side of the mode machine, which a command may have chosen.

        The choice is not saved; `param set navigator` saves it.
        """
        machine, params = self._machine, self.params
        if (machine.navigator, machine.side) == (params.navigator, params.side):
            return
        values = {"navigator": float(machine.navigator), "side": float(machine.side)}
        self._core.adopt(with_values(params, values))
        self.forget_text()

    def read(self, request: ParamRequestRead) -> CommandAck | ParamValue:
        """Return a parameter by name or index, or a refusal."""
        name = request.param_id
        if 0 <= request.param_index < len(TABLE):
            name = TABLE[request.param_index].name
        return self._value(name) if name in SPECS else ack(reasons.UNKNOWN_PARAMETER)

    def safety_changes(self) -> list[str]:
        """Return the safety parameters that differ from the configuration, with both values."""
        if self.configured is None:
            return []
        changes = []
        for spec in TABLE:
            value = float(getattr(self.params, spec.name))
            limit = float(getattr(self.configured, spec.name))
            if spec.safer and abs(value - limit) > ROUNDING * abs(limit):
                changes.append(f"{spec.name} {value:g} ({limit:g})")
        return changes

    def _unsafe(self, name: str, value: float) -> int:
        """Return why a safety parameter may not have this value now, or 0."""
        if not SPECS[name].safer or value == getattr(self.params, name):
            return reasons.OK
        if self._machine.vehicle == states.ACTIVE:
            return reasons.NOT_WHILE_ARMED
        if self.configured is not None and is_less_safe(name, value, self.configured):
            return reasons.LESS_SAFE_THAN_CONFIGURED
        return reasons.OK

    def _value(self, name: str) -> ParamValue:
        spec = SPECS[name]
        return ParamValue(
            param_id=name,
            param_value=float(getattr(self.params, name)),
            param_type=PARAM_TYPE_INT32 if spec.integer else PARAM_TYPE_REAL32,
            param_count=len(TABLE),
            param_index=TABLE.index(spec),
        )
