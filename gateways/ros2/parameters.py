"""The six parameter services of a node, and /parameter_events when a value has changed.

They are those of the robot, in its own units, as doubles and integers, with `use_sim_time` as each
node of ROS has it. A change takes the lease, and the robot may refuse it; the reason is returned.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isfinite
from typing import Any, Final

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__FloatingPointRange as Limits
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__IntegerRange as WholeLimits
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__ListParametersResult as Listed
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__Parameter as RosParameter
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__ParameterDescriptor as Descriptor
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__ParameterEvent as Event
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__ParameterValue as Value
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__SetParametersResult as SetResult

from gateways.ros2.node import RosNode
from gateways.ros2.wire import Attachment
from ground.client.outcomes import Refused
from ground.client.parameter import Parameter, same
from ground.robot import Robot
from ground.ros2.messages import time_of
from ground.ros2.offer import PARAMETERS
from runtime.errors import LocalError, RemoteError

NOT_SET: Final = 0
BOOL: Final = 1
INTEGER: Final = 2
DOUBLE: Final = 3
PACKAGE: Final = "rcl_interfaces/srv"
SIM_TIME: Final = "use_sim_time"
READ_ONLY: Final = "this gateway is read-only: start it with --no-read-only to set parameters"


def value_of(kind: int, number: float = 0.0) -> Value:
    """Return a value of ROS."""
    nothing = np.zeros(0, np.uint8)
    whole, real = np.zeros(0, np.int64), np.zeros(0, np.float64)
    return Value(
        kind,
        bool(number) if kind == BOOL else False,
        round(number) if kind == INTEGER else 0,
        number if kind == DOUBLE else 0.0,
        "",
        nothing,
        np.zeros(0, np.bool_),
        whole,
        real,
        [],
    )


def number_in(value: Any) -> float | None:
    """Return the number in a value; None for one of another type, or none that is finite."""
    if value.type == INTEGER:
        return float(value.integer_value)
    if value.type == DOUBLE and isfinite(value.double_value):
        return float(value.double_value)
    return None


def descriptor_of(one: Parameter, *, read_only: bool) -> Descriptor:
    """Return meaning, unit and range of a parameter."""
    reals, wholes = [], []
    if one.minimum is not None and one.maximum is not None:
        if one.integer:
            wholes = [WholeLimits(round(one.minimum), round(one.maximum), 1)]
        else:
            reals = [Limits(one.minimum, one.maximum, 0.0)]
    text = f"{one.doc} ({one.unit})" if one.unit else one.doc
    kind = INTEGER if one.integer else DOUBLE
    limits = "safer only, while disarmed" if one.direction else ""
    return Descriptor(one.name, kind, text, limits, read_only, False, reals, wholes)


class ParameterServices:
    """Serves the parameters of a robot; `now_ns` is the time of ROS."""

    def __init__(
        self,
        node: RosNode,
        robot: Robot,
        now_ns: Callable[[], int],
        is_simulated: Callable[[], bool],
        *,
        read_only: bool = False,
    ) -> None:
        self._robot, self._read_only = robot, read_only
        self._now_ns, self._is_simulated = now_ns, is_simulated
        self._name = node.name.resolve("~/")[:-1]
        self._make = node.session.interfaces.make
        self._events = node.publisher(
            "/parameter_events", "rcl_interfaces/msg/ParameterEvent", PARAMETERS
        )
        self._known: dict[str, Parameter] = {}
        for name, kind, serve in (
            ("describe_parameters", "DescribeParameters", self._describe),
            ("get_parameters", "GetParameters", self._get),
            ("get_parameter_types", "GetParameterTypes", self._get_types),
            ("list_parameters", "ListParameters", self._list),
            ("set_parameters", "SetParameters", self._set),
            ("set_parameters_atomically", "SetParametersAtomically", self._set_atomically),
        ):
            node.serve(f"~/{name}", f"{PACKAGE}/{kind}", serve, PARAMETERS)

    async def refresh(self) -> Mapping[str, Parameter]:
        """Read the parameters of the robot, and publish those that have changed.

        Raises RemoteError without an answer.
        """
        found = {one.name: one for one in await self._robot.parameters.fetch()}
        known, self._known = self._known, found
        new = [one for name, one in found.items() if name not in known]
        gone = [one for name, one in known.items() if name not in found]
        changed = [
            one
            for name, one in found.items()
            if name in known and not same(one.value, known[name].value)
        ]
        if new or gone or changed:
            groups = [[self._as_ros(one) for one in group] for group in (new, changed, gone)]
            self._events.publish(Event(time_of(self._now_ns()), self._name, *groups))
        return found

    def _as_ros(self, one: Parameter) -> RosParameter:
        return RosParameter(one.name, self._value(one))

    @staticmethod
    def _value(one: Parameter) -> Value:
        return value_of(INTEGER if one.integer else DOUBLE, one.value)

    async def _all(self) -> Mapping[str, Parameter]:
        """Return the parameters of now, or the newest known if the robot does not answer."""
        try:
            return await self.refresh()
        except RemoteError:
            return self._known

    async def _describe(self, request: Any, _attachment: Attachment) -> Any:
        found = await self._all()
        unknown = Descriptor("", NOT_SET, "", "", False, False, [], [])
        described = {
            name: descriptor_of(one, read_only=self._read_only) for name, one in found.items()
        }
        text = "whether the time of the simulation is used"
        described[SIM_TIME] = Descriptor(SIM_TIME, BOOL, text, "", True, False, [], [])
        answers = [described.get(name, unknown) for name in request.names]
        return self._make(f"{PACKAGE}/DescribeParameters_Response", answers)

    async def _get(self, request: Any, _attachment: Attachment) -> Any:
        values = await self._values(request.names)
        return self._make(f"{PACKAGE}/GetParameters_Response", values)

    async def _get_types(self, request: Any, _attachment: Attachment) -> Any:
        kinds = [value.type for value in await self._values(request.names)]
        return self._make(f"{PACKAGE}/GetParameterTypes_Response", np.array(kinds, np.uint8))

    async def _values(self, names: Iterable[str]) -> list[Value]:
        values = {name: self._value(one) for name, one in (await self._all()).items()}
        values[SIM_TIME] = value_of(BOOL, self._is_simulated())
        return [values.get(name, value_of(NOT_SET)) for name in names]

    async def _list(self, request: Any, _attachment: Attachment) -> Any:
        found = sorted([*(await self._all()), SIM_TIME])
        prefixes = tuple(request.prefixes)
        if prefixes:
            begun = tuple(f"{prefix}." for prefix in prefixes)
            found = [name for name in found if name in prefixes or name.startswith(begun)]
        return self._make(f"{PACKAGE}/ListParameters_Response", Listed(found, []))

    async def _set(self, request: Any, _attachment: Attachment) -> Any:
        known = await self._all()
        results = []
        for one in request.parameters:
            why = self._fault(one, known) or await self._change(one)
            results.append(SetResult(not why, why))
        await self._all()
        return self._make(f"{PACKAGE}/SetParameters_Response", results)

    async def _set_atomically(self, request: Any, _attachment: Attachment) -> Any:
        """Set all, or none: what was set before a refusal gets its former value again."""
        known = await self._all()
        faults = (self._fault(one, known) for one in request.parameters)
        why = next(filter(None, faults), "") or await self._change_all(request.parameters)
        await self._all()
        name = f"{PACKAGE}/SetParametersAtomically_Response"
        return self._make(name, SetResult(not why, why))

    def _fault(self, one: Any, known: Mapping[str, Parameter]) -> str:
        """Return why a value cannot be set, without asking the robot."""
        if self._read_only:
            return READ_ONLY
        if one.name == SIM_TIME:
            return f"{SIM_TIME} follows the simulation"
        if one.name not in known:
            return f"the robot has no parameter {one.name!r}"
        found, number = known[one.name], number_in(one.value)
        if number is None or (found.integer and number != round(number)):
            kind = "an integer" if found.integer else "a finite double"
            return f"{one.name} is {kind}"
        if found.minimum is not None and number < found.minimum:
            return f"{one.name} = {number:g}: at least {found.minimum:g} {found.unit}".rstrip()
        if found.maximum is not None and number > found.maximum:
            return f"{one.name} = {number:g}: at most {found.maximum:g} {found.unit}".rstrip()
        return ""

    async def _change(self, one: Any) -> str:
        number = number_in(one.value)
        assert number is not None, "checked by _fault"
        try:
            changed = await self._robot.parameters.change(one.name, number)
        except (LocalError, RemoteError) as error:
            return str(error)
        if isinstance(changed, Refused):
            return changed.words
        return "" if changed.ok else changed.refusal or changed.text

    async def _change_all(self, wanted: Sequence[Any]) -> str:
        values = {one.name: number_in(one.value) or 0.0 for one in wanted}
        try:
            loaded = await self._robot.parameters.restore(values)
            if isinstance(loaded, Refused):
                return loaded.words
            if loaded.refusal:
                await self._robot.parameters.restore(dict(loaded.before))
        except (LocalError, RemoteError) as error:
            return str(error)
        return loaded.refusal
