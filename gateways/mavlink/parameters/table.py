"""The parameters for MAVLink clients: the robot's own, then those for compatibility."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import isfinite
from typing import Final

from gateways.mavlink.ardupilot_parameters import compatibility_parameters
from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.parameters.names import mavlink_name
from ground.client.parameter import Parameter, same

SMALLEST_NORMAL: Final = 1.1754943508222875e-38
LARGEST_FLOAT: Final = 3.4028234663852886e38
LARGEST_INTEGER: Final = 0x7FFF_FFFF


@dataclass(frozen=True, slots=True)
class MavParameter:
    """A parameter with its MAVLink name; `is_fixed`: not of the robot, never changes."""

    name: str
    own: Parameter
    is_fixed: bool = False

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


def table_of(parameters: Iterable[Parameter]) -> MavTable:
    """Return the table for the robot's parameters."""
    named = ((mavlink_name(one.name), one) for one in parameters)
    own = {name: MavParameter(name, one) for name, one in named if name}
    fixed = (MavParameter(one.name, one, is_fixed=True) for one in compatibility_parameters())
    return MavTable([*own.values(), *(one for one in fixed if one.name not in own)])


def is_cast(value: float) -> bool:
    """Return whether a value can be a number that was cast to float.

    A client that copies the bytes of a whole number instead sends 2 as 2.8e-45, and -1 as NaN.
    """
    return isfinite(value) and (value == 0.0 or abs(value) >= SMALLEST_NORMAL)
