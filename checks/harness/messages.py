"""Messages made up for tests and measurements: at rest, but for what the caller names."""

from functools import cache
from typing import Any, Final, TypeVar

from msgspec import structs

from protocol.wire.enums import (
    AUTOPILOT_ARDUPILOTMEGA,
    MODE_FLAG_CUSTOM_MODE_ENABLED,
    PARAM_TYPE_REAL32,
    TYPE_GROUND_ROVER,
    Mode,
    Navigator,
    SystemState,
    Vehicle,
)
from protocol.wire.message import LAYOUT, Message
from protocol.wire.messages import Heartbeat, NavigatorStatus, ParamSet, ParamValue, SonarScan

M = TypeVar("M", bound=Message)
AT_REST: Final[dict[type[Message], dict[str, Any]]] = {
    Heartbeat: {
        "type": TYPE_GROUND_ROVER,
        "autopilot": AUTOPILOT_ARDUPILOTMEGA,
        "base_mode": MODE_FLAG_CUSTOM_MODE_ENABLED,
        "system_status": int(SystemState.STANDBY),
    },
    NavigatorStatus: {
        "vehicle": Vehicle.ACTIVE,
        "mode": Mode.GUIDED,
        "navigator": Navigator.VGM,
        "side": 1,
    },
    ParamSet: {"param_type": PARAM_TYPE_REAL32},
    ParamValue: {"param_type": PARAM_TYPE_REAL32},
    SonarScan: {"valid": 0xFF},
}
"""What is not 0 of an armed robot without a goal, whose sonars measure and have no echo."""


def make(kind: type[M], **changes: Any) -> M:
    """Return a message of this kind at rest, but for `changes`."""
    return kind(**{**fields_at_rest(kind), **changes})


@cache
def fields_at_rest(kind: type[Message]) -> dict[str, Any]:
    """Return the fields of a robot at rest: what has no default in the dialect is 0 or empty."""
    has_default = {one.name for one in structs.fields(kind) if not one.required}
    fields: dict[str, Any] = {}
    for field in LAYOUT[kind.__name__].fields:
        zero = 0.0 if field.code in "fd" else 0
        if field.name not in has_default:
            fields[field.name] = "" if field.is_text else (zero,) * field.length or zero
    return fields | AT_REST.get(kind, {})
