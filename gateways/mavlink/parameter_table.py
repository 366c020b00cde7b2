"""The parameters for MAVLink clients: the robot's own, then those for compatibility; as files, too.

A name has at most 16 bytes, in upper case. Ground stations look up descriptions by the names of
ArduPilot's Rover, so none of the robot's own is one of them. Some ground stations change names to
upper case before they send them.

GUID_TIMEOUT is the only parameter of the gateway itself. Like ArduPilot's of the same name, it is
the time-out of speeds in GUIDED.

Parameters for compatibility exist only so that ground stations accept the vehicle as an ArduPilot
Rover. QGroundControl's set-up pages and Mission Planner ask for them by name. They are read-only,
describe no part of the robot, and are not in `param list`. FRAME_CLASS is left out: with it,
QGroundControl shows a page about frames that do not apply to this robot.

COMPONENT_METADATA (row 23 of the list) names the general file, which names the file of the
parameters. QGroundControl reads only version 1 of both.

The packed file `@PARAM/param.pck` of ArduPilot (row 20 of the list): a header of three 16-bit
numbers: kind, parameters in this file, parameters in all. Then for each parameter: type and flags,
lengths of the name's shared and own parts, the own part, the value, and the default if it differs.
ArduPilot pads entries because values may change while the file is read. Here the file contains the
values at the time when it was opened, so it needs no padding.
"""

import json
import lzma
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from itertools import takewhile
from math import isfinite
from struct import Struct
from types import MappingProxyType
from typing import Any, Final, NamedTuple
from urllib.parse import parse_qsl

from gateways.mavlink.ftp_messages import checksum
from gateways.mavlink.mavlink_dialect import ComponentMetadata, MavMessage, mavlink
from ground.client.parameter import Parameter, same
from ground.client.vocabulary import NAMED_VALUES

MAX_NAME_BYTES: Final = 16
MAVLINK_NAMES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "radius_m": "RADIUS_M",
        "track_m": "TRACK_M",
        "wheel_radius_m": "WHEEL_RADIUS_M",
        "wheel_ratio": "WHEEL_RATIO",
        "m_per_tick": "M_PER_TICK",
        "wheel_max_m_s": "WHEEL_MAX_M_S",
        "v_max_m_s": "V_MAX_M_S",
        "yaw_max_rad_s": "YAW_MAX_RAD_S",
        "accel_m_s2": "ACCEL_M_S2",
        "period_s": "PERIOD_S",
        "k_r_m": "K_R_M",
        "k_l_m": "K_L_M",
        "sonar_max_m": "SONAR_MAX_M",
        "sonar_stale_ms": "SONAR_STALE_MS",
        "freeze_m": "FREEZE_M",
        "freeze_rad": "FREEZE_RAD",
        "freeze_front_m": "FREEZE_FRONT_M",
        "navigator": "NAVIGATOR",
        "side": "SIDE",
        "d_obs_m": "D_OBS_M",
        "d_th_m": "D_TH_M",
        "follow_m": "FOLLOW_M",
        "k_rho": "K_RHO",
        "k_omega": "K_OMEGA",
        "pose_k_rho": "POSE_K_RHO",
        "pose_k_omega": "POSE_K_OMEGA",
        "pose_h": "POSE_H",
        "pose_from_m": "POSE_FROM_M",
        "align_k": "ALIGN_K",
        "align_min_rad_s": "ALIGN_MIN_RAD_S",
        "spin_room_m": "SPIN_ROOM_M",
        "goal_max_m": "GOAL_MAX_M",
        "guard_stop_m": "GUARD_STOP_M",
        "guard_time_s": "GUARD_TIME_S",
        "op_lost_ms": "OP_LOST_MS",
        "wheel_min_m_s": "WHEEL_MIN_M_S",
        "wheel_time_ms": "WHEEL_TIME_MS",
        "wheel_share": "WHEEL_SHARE",
        "stuck_ms": "STUCK_MS",
        "stuck_m": "STUCK_M",
        "stuck_rad": "STUCK_RAD",
        "progress_ms": "PROGRESS_MS",
        "progress_m": "PROGRESS_M",
    }
)


def mavlink_name(name: str) -> str:
    """Return the name for MAVLink; a parameter that is not listed keeps its name, in upper case.

    The result is empty if that would be too long: such a parameter cannot be shown.
    """
    listed = MAVLINK_NAMES.get(name) or name.upper()
    return listed if len(listed) <= MAX_NAME_BYTES else ""


STICKS: Final = ("ROLL", "PITCH", "THROTTLE", "YAW")
AXES: Final = "XYZ"
COMPASSES: Final = ("", "2", "3")
GROUP: Final = "ArduPilot"
DOC: Final = "fixed: for ground stations that expect an ArduPilot Rover"
PWM: Final = (("MIN", 1000), ("MAX", 2000), ("TRIM", 1500))
"""The usual pulses in microseconds; with a MIN of 1100 a radio counts as not calibrated."""
CALIBRATED: Final = 0.001
"""An offset of an accelerometer in m/s^2; at 0 it counts as not calibrated."""


def compatibility_parameters() -> tuple[Parameter, ...]:
    """Return them in their order."""
    return tuple(
        Parameter(name=name, value=value, default=value, integer=isinstance(value, int), doc=DOC)
        for name, value in _values()
    )


def _values() -> Iterator[tuple[str, float]]:
    for channel, stick in enumerate(STICKS, start=1):
        yield f"RCMAP_{stick}", channel
    for channel in range(1, 1 + len(STICKS)):
        for limit, width_us in PWM:
            yield f"RC{channel}_{limit}", width_us
    for compass in COMPASSES:
        yield f"COMPASS_DEV_ID{compass}", 0
        yield f"COMPASS_USE{compass}", 0
        for axis in AXES:
            yield f"COMPASS_OFS{compass}_{axis}", 0.0
    for axis in AXES:
        yield f"INS_ACCOFFS_{axis}", CALIBRATED
    yield "BATT_CAPACITY", 0
    yield "BATT_MONITOR", 0


SMALLEST_NORMAL: Final = 1.1754943508222875e-38
LARGEST_FLOAT: Final = 3.4028234663852886e38
LARGEST_INTEGER: Final = 0x7FFF_FFFF


MIN_TIMEOUT_S, MAX_TIMEOUT_S = 1.0, 3.0
"""The longest is ArduPilot's, and shorter than the silence after which a client loses control."""


def timeout_parameter(value_s: float) -> Parameter:
    """Return the parameter of the gateway: the time-out of speeds in GUIDED."""
    return Parameter(
        name="GUID_TIMEOUT",
        value=value_s,
        default=MIN_TIMEOUT_S,
        minimum=MIN_TIMEOUT_S,
        maximum=MAX_TIMEOUT_S,
        unit="s",
        doc="in GUIDED the robot stops so long after the last speed or attitude",
    )


class Owner(Enum):
    """Whose a parameter is. That of NOBODY never changes."""

    ROBOT = "Sidestep"
    GATEWAY = "Gateway"
    NOBODY = "ArduPilot"


@dataclass(frozen=True, slots=True)
class MavParameter:
    """A parameter with its MAVLink name."""

    name: str
    own: Parameter
    owner: Owner = Owner.ROBOT

    @property
    def is_fixed(self) -> bool:
        """True if it never changes."""
        return self.owner is Owner.NOBODY

    @property
    def mav_type(self) -> int:
        """All whole numbers are INT32, all others REAL32."""
        integer, real = mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_REAL32
        return int(integer if self.own.integer else real)

    @property
    def value(self) -> float:
        """The value, limited to the range of its type."""
        return self.carried(self.own.value)

    @property
    def default(self) -> float:
        """The default value, or the value if there is no default."""
        return self.value if self.own.default is None else self.carried(self.own.default)

    def carried(self, value: float) -> float:
        """Return a value, limited to the range of the parameter's type."""
        largest = LARGEST_INTEGER if self.own.integer else LARGEST_FLOAT
        return max(-largest, min(largest, value))


class MavTable:
    """The parameters in the order of their indexes, which never changes while the list is equal."""

    def __init__(self, parameters: Iterable[MavParameter]) -> None:
        self.parameters = tuple(parameters)
        self._indexes = {one.name: index for index, one in enumerate(self.parameters)}

    def __len__(self) -> int:
        return len(self.parameters)

    def index(self, name: str) -> int | None:
        """Return the index of a name, None if there is no such parameter."""
        return self._indexes.get(name)

    def message(self, index: int) -> MavMessage:
        """Return PARAM_VALUE of one parameter; its value is cast to float, as ArduPilot does."""
        found = self.parameters[index]
        return mavlink.MAVLink_param_value_message(
            found.name.encode(), found.value, found.mav_type, len(self), index
        )

    def changed_since(self, older: "MavTable") -> list[int]:
        """Return the indexes of the values that differ from those of an older table."""
        values = {one.name: one.own.value for one in older.parameters}
        return [
            index
            for index, one in enumerate(self.parameters)
            if not same(values.get(one.name, one.own.value), one.own.value)
        ]

    def describes_same(self, other: "MavTable") -> bool:
        """Return whether both tables have the same parameters; the values may differ."""

        def descriptions(table: MavTable) -> list[Parameter]:
            return [replace(one.own, value=0.0) for one in table.parameters]

        return descriptions(self) == descriptions(other)

    def with_value(self, index: int, value: float) -> "MavTable":
        """Return a copy with one value changed."""
        changed = list(self.parameters)
        changed[index] = replace(changed[index], own=changed[index].own.with_value(value))
        return MavTable(changed)


def table_of(parameters: Iterable[Parameter], timeout_s: float = MIN_TIMEOUT_S) -> MavTable:
    """Return the table for the robot's parameters and that of the gateway."""
    named = ((mavlink_name(one.name), one) for one in parameters)
    own = {name: MavParameter(name, one) for name, one in named if name}
    timeout = timeout_parameter(timeout_s)
    others = [MavParameter(timeout.name, timeout, Owner.GATEWAY)]
    others += [MavParameter(one.name, one, Owner.NOBODY) for one in compatibility_parameters()]
    return MavTable([*own.values(), *(one for one in others if one.name not in own)])


def is_cast(value: float) -> bool:
    """Return whether a value can be a number that was cast to float.

    A client that copies the bytes of a whole number instead sends 2 as 2.8e-45, and -1 as NaN.
    """
    return isfinite(value) and (value == 0.0 or abs(value) >= SMALLEST_NORMAL)


GENERAL_NAME: Final = "general.json.xz"
PARAMETERS_NAME: Final = "parameters.json.xz"
SCHEME: Final = "mftp:///"
VERSION: Final = 1
PARAMETER_KIND: Final = 1
FILTERS: Final = ({"id": lzma.FILTER_LZMA2, "preset": 1, "dict_size": 1 << 16},)
"""A small dictionary keeps the memory of the compression small."""


class Metadata(NamedTuple):
    """The two compressed files."""

    general: bytes
    parameters: bytes


def metadata_of(table: MavTable) -> Metadata:
    """Return the files that describe the parameters of a table, whatever their values are."""
    rows = [described(one) for one in table.parameters]
    parameters = _compressed({"version": VERSION, "parameters": rows})
    entry = {
        "type": PARAMETER_KIND,
        "uri": SCHEME + PARAMETERS_NAME,
        "fileCrc": checksum(parameters),
    }
    general = {"version": VERSION, "vendorName": "Sidestep", "metadataTypes": [entry]}
    return Metadata(_compressed(general), parameters)


def component_metadata(metadata: Metadata, time_ms: int) -> MavMessage:
    """Return the message that names the general file."""
    uri = (SCHEME + GENERAL_NAME).encode()
    return ComponentMetadata(time_ms, checksum(metadata.general), uri)


def described(one: MavParameter) -> dict[str, Any]:
    """Return the description of one parameter."""
    own = one.own
    row: dict[str, Any] = {
        "name": one.name,
        "type": "Int32" if own.integer else "Float",
        "shortDesc": own.doc or own.name,
        "longDesc": _long(one),
        "units": own.unit,
        "default": own.default,
        "min": own.minimum,
        "max": own.maximum,
        "group": one.owner.value,
        "category": "Safety" if own.direction else "Standard",
        "values": _choices(one),
        "readOnly": True if one.is_fixed else None,
    }
    return {key: value for key, value in row.items() if value not in (None, "", [])}


def _long(one: MavParameter) -> str:
    if one.owner is not Owner.ROBOT:
        return one.own.doc
    safer = f" Safety group; safer is {one.own.direction}." if one.own.direction else ""
    return f"{one.own.doc} ({one.own.name} in `sidestep param list`).{safer}"


def _choices(one: MavParameter) -> list[dict[str, Any]]:
    """Return the values that have names."""
    named = NAMED_VALUES.get(one.own.name, {})
    return [{"value": int(value), "description": name} for name, value in named.items()]


def _compressed(content: dict[str, Any]) -> bytes:
    text = json.dumps(content, separators=(",", ":")).encode()
    return lzma.compress(text, check=lzma.CHECK_CRC32, filters=[dict(one) for one in FILTERS])


PLAIN, WITH_DEFAULTS = 0x671B, 0x671C
HEADER: Final = Struct("<HHH")
INTEGER: Final = (3, Struct("<i"))
REAL: Final = (4, Struct("<f"))
HAS_DEFAULT: Final = 0x10
MAX_SHARED: Final = 15
MAX_NUMBER: Final = 0xFFFE


class Selection(NamedTuple):
    """The parameters that a client asks for; a limit of 0 is all from `start` on."""

    start: int = 0
    limit: int = 0
    with_defaults: bool = False


def selection_in(query: str) -> Selection | None:
    """Parse the text after the `?` of a name; None if a number is invalid."""
    found = {"start": 0, "count": 0, "withdefaults": 0}
    limits = {"start": MAX_NUMBER, "count": MAX_NUMBER, "withdefaults": 1}
    for key, text in parse_qsl(query, keep_blank_values=True):
        if key in found:
            if not (text.isascii() and text.isdecimal() and len(text) <= len(str(MAX_NUMBER))):
                return None
            found[key] = int(text)
            if found[key] > limits[key]:
                return None
    return Selection(found["start"], found["count"], found["withdefaults"] == 1)


def packed(table: MavTable, selection: Selection) -> bytes | None:
    """Return the file; None if it begins behind the last parameter."""
    total = len(table)
    if selection.start >= total:
        return None
    end = selection.start + selection.limit if selection.limit else total
    chosen = table.parameters[selection.start : end]
    kind = WITH_DEFAULTS if selection.with_defaults else PLAIN
    parts = [HEADER.pack(kind, len(chosen), total)]
    before = ""
    for one in chosen:
        parts.append(_entry(one, before, with_default=selection.with_defaults))
        before = one.name
    return b"".join(parts)


def _entry(one: MavParameter, before: str, *, with_default: bool) -> bytes:
    kind, layout = INTEGER if one.own.integer else REAL
    cast = int if one.own.integer else float
    value, default = layout.pack(cast(one.value)), layout.pack(cast(one.default))
    has_default = with_default and value != default
    equal = takewhile(lambda pair: pair[0] == pair[1], zip(before, one.name, strict=False))
    shared = min(MAX_SHARED, len(one.name) - 1, len(list(equal)))
    own = one.name[shared:].encode()
    head = bytes([kind | (HAS_DEFAULT if has_default else 0), shared | (len(own) - 1) << 4])
    return head + own + value + (default if has_default else b"")
