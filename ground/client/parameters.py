"""The parameters of a robot: read all or some of them, set one or several."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from math import isfinite, nan
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ground.client import parameter_file
from ground.client.connection import within
from ground.client.leases import Asker
from ground.client.outcomes import Refused
from ground.client.parameter import Parameter, parameters_in, same
from ground.client.requests import Exchange, is_saving
from ground.client.vocabulary import value_words
from protocol.topics import PARAMETER, PARAMETERS
from protocol.wire.enums import PARAM_TYPE_REAL32
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, ParamSet, ParamValue
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError, UserError

FLT_MAX: Final = 3.4e38
SAVING_NS: Final = 15_000_000_000
"""Time limit, longer than the robot waits for its disk before it answers NOT_SAVED."""
SHOWN: Final = 3
"""Names of others that are listed."""
NO_CHANGE: Final = "no change: the robot has all values of the file"
SAVED: Final[Mapping[bool | None, str]] = MappingProxyType(
    {
        True: "saved on the robot",
        False: "in force until the robot restarts: without --state DIR it saves nothing",
        None: "in force; the robot does not report whether it is saved",
    }
)
ALLOWED: Final[Mapping[str, str]] = MappingProxyType(
    {"up": ", no lower", "down": ", no higher", "near": ", within a tenth of that"}
)
"""Values of a safety parameter, by its direction."""


class ParameterExchange(Exchange[Message | bytes]):
    """A request for the parameter list, or for a new value of one parameter.

    Setting the same value twice is harmless. While the robot is still saving the value, the request
    is repeated for as long as a slow disk may take.
    """

    def __init__(self, request: ParamSet | None, now_ns: int) -> None:
        super().__init__(request, now_ns)
        self._until_ns = now_ns + SAVING_NS

    def _is_out_of_time(self, now_ns: int) -> bool:
        return now_ns >= self._until_ns

    def _take(self, answer: object, now_ns: int) -> None:
        if is_saving(answer):
            self.unanswered("in force, still being saved")
            self._ask_next(self._question, now_ns)
        elif isinstance(answer, Message | bytes):
            self.outcome = answer


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChanged:
    """The result of setting a parameter; `now` is the value in force, None after a refusal.

    `saved`: it survives a restart; None if the robot does not report that. `reason` is that of the
    refusal.
    """

    name: str
    asked: float
    now: float | None
    saved: bool | None = None
    refusal: str = ""
    reason: int = Reason.NONE

    @property
    def ok(self) -> bool:
        """True if the requested value is in force."""
        now = self.now
        return now is not None and isfinite(now) and same(now, self.asked)

    @property
    def text(self) -> str:
        """The value in force, or the refusal."""
        if self.now is None:
            return f"refused: {self.name} = {value_words(self.name, self.asked)}: {self.refusal}"
        if not self.ok:
            return f"not changed: the robot keeps {self.name} = {value_words(self.name, self.now)}"
        return f"{self.name} = {value_words(self.name, self.now)}, {SAVED[self.saved]}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the result as a row."""
        row: dict[str, object] = {"verb": "param set", "robot": robot, "name": self.name}
        row |= {"ok": self.ok, "value": self.now}
        if self.now is None:
            return row | {"reason": self.refusal}
        return row | {
            "reason": "ok" if self.ok else "the robot keeps another value",
            "saved": self.saved,
        }


@dataclass(frozen=True, slots=True)
class ParametersSaved:
    """The parameters written to a file; without a file, those that the robot saves by itself."""

    names: tuple[str, ...]
    file: Path | None = None

    @property
    def ok(self) -> bool:
        """True if there is a file, or if the robot saves a parameter."""
        return self.file is not None or bool(self.names)

    @property
    def text(self) -> str:
        """The names, and where they are saved."""
        names = ", ".join(self.names)
        if self.file is not None:
            return f"{self.file}: {names or 'all parameters have their default values'}"
        if names:
            return f"nothing to do: saved on the robot: {names}"
        return "nothing is saved; a robot with --state DIR saves each value when it is set"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return names and file as a row."""
        file = {} if self.file is None else {"file": str(self.file)}
        return {"verb": "param save", "ok": self.ok, **file, "saved": list(self.names)}


@dataclass(frozen=True, slots=True)
class ParametersLoaded:
    """The parameters that were set, with the values before, and the refusal that ended it.

    `others` are names in the file that are not the robot's.
    """

    before: tuple[tuple[str, float], ...]
    refusal: str = ""
    others: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters that were set."""
        return tuple(name for name, _ in self.before)

    @property
    def ok(self) -> bool:
        """True if no value was refused."""
        return not self.refusal

    @property
    def text(self) -> str:
        """The refusal if any, then the names."""
        done = f"set: {', '.join(self.names)}" if self.names else NO_CHANGE
        if self.others:
            more = f" and {len(self.others) - SHOWN} more" if len(self.others) > SHOWN else ""
            done += f"; not of this robot: {', '.join(self.others[:SHOWN])}{more}"
        return f"{self.refusal}; {done}" if self.refusal else done

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return names and refusal as a row."""
        row = {"verb": "param load", "ok": self.ok, "set": [*self.names], "reason": self.refusal}
        return row | {"others": [*self.others]} if self.others else row


class Parameters:
    """The robot's parameters, each in its own unit."""

    def __init__(self, robot: Asker) -> None:
        self._robot = robot

    async def list(self, pattern: str = "*") -> tuple[Parameter, ...]:
        """Return the parameters whose names match, as in `sonar_*`; UserError if none does."""
        everything = await self.fetch()
        chosen = tuple(one for one in everything if fnmatchcase(one.name, pattern))
        if not chosen:
            near = nearest([one.name for one in everything], pattern)
            remedy = f"did you mean {near!r}?" if near else self._robot.remedies.parameters
            raise UserError(f"no parameter matches {pattern!r}: {remedy}")
        return chosen

    async def get(self, name: str) -> Parameter:
        """Return one parameter; UserError if the robot has no such parameter."""
        (found,) = await self.list(name)
        return found

    async def changed(self) -> tuple[Parameter, ...]:
        """Return the parameters that differ from their defaults."""
        return tuple(one for one in await self.fetch() if not one.is_default)

    async def set(self, name: str, value: float) -> ParameterChanged | Refused:
        """Set one parameter; `ok` if the value is in force, `saved` if it survives a restart.

        UserError if the robot has no such parameter.
        """
        within(value, -FLT_MAX, FLT_MAX, name)
        changed = await self.change(name, value)
        if isinstance(changed, ParameterChanged) and changed.reason == Reason.UNKNOWN_PARAMETER:
            raise UserError(changed.refusal)
        return changed

    async def reset(self, name: str) -> ParameterChanged | Refused:
        """Set one parameter to its default value; UserError if the robot has none for it."""
        return await self.change(name, None)

    async def load(self, file: str | Path) -> ParametersLoaded | Refused:
        """Set all values of a TOML, .param or .params file; none unless all are allowed.

        ConfigError names one that is not. Parameters in a file of a ground station that are not the
        robot's are left out.
        """
        if (refused := await self._robot.lease.ensure()) is not None:
            return refused
        found = await self.fetch()
        values, others = parameter_file.read(Path(file), found)
        return replace(await self._restore(found, values), others=others)

    async def save(self, file: str | Path | None) -> ParametersSaved:
        """Write the parameters that differ from their defaults to a file; its suffix is its form.

        Without a file, list those that the robot saves by itself.
        """
        found = await self.fetch()
        if file is None:
            return ParametersSaved(tuple(one.name for one in found if one.saved))
        return ParametersSaved(tuple(parameter_file.write(Path(file), found)), Path(file))

    async def fetch(self) -> Sequence[Parameter]:
        """Return all parameters; RemoteError if the list is missing or malformed."""
        answer = await self._robot.exchange(self._exchange(None), PARAMETERS)
        if not isinstance(answer, bytes):
            raise RemoteError("the robot's reply is not a parameter list")
        return parameters_in(answer)

    async def change(self, name: str, value: float | None) -> ParameterChanged | Refused:
        """Set one parameter, to its default without a value, and read back whether it is saved."""
        if (refused := await self._robot.lease.ensure()) is not None:
            return refused
        if value is None:
            value = await self._default(name)
        now = await self._set(name, value)
        if isinstance(now, Refused):
            return ParameterChanged(
                name=name,
                asked=value,
                now=None,
                refusal=now.words + await self._hint(name, now.reason),
                reason=now.reason,
            )
        changed = ParameterChanged(name=name, asked=value, now=now)
        return replace(changed, saved=await self._is_saved(name))

    async def _default(self, name: str) -> float:
        defaults = {one.name: one.default for one in await self.fetch()}
        value = defaults.get(name)
        if value is None:
            near = get_close_matches(name, defaults, n=1)
            fix = f"did you mean {near[0]}?" if near else self._robot.remedies.parameters
            raise UserError(f"no parameter {name!r} with a default: {fix}")
        return value

    async def restore(self, wanted: Mapping[str, float]) -> ParametersLoaded | Refused:
        """Set the values that differ, until one is refused."""
        if (refused := await self._robot.lease.ensure()) is not None:
            return refused
        return await self._restore(await self.fetch(), wanted)

    async def _restore(
        self, found: Sequence[Parameter], wanted: Mapping[str, float]
    ) -> ParametersLoaded:
        values = {one.name: one.value for one in found}
        done: list[tuple[str, float]] = []
        for name, value in wanted.items():
            if same(before := values.get(name, nan), value):
                continue
            answer = await self._set(name, value)
            if isinstance(answer, Refused):
                refusal = f"refused: {name} = {number(value)}: {answer.words}"
                return ParametersLoaded(tuple(done), refusal)
            done.append((name, before))
        return ParametersLoaded(tuple(done))

    async def _set(self, name: str, value: float) -> float | Refused:
        """Set one parameter; return the value that is in force now, or the refusal."""
        robot, asked_ns = self._robot, self._robot.clock.now_ns()
        request = ParamSet(param_id=name, param_value=value, param_type=PARAM_TYPE_REAL32)
        answer = await robot.exchange(self._exchange(request), PARAMETER)
        if isinstance(answer, ParamValue):
            return float(answer.param_value)
        took_ns = robot.clock.now_ns() - asked_ns
        reason = answer.result_param2 if isinstance(answer, CommandAck) else Reason.MALFORMED
        holder = await robot.refusing_holder(reason)
        return Refused(reason, took_ns, holder, remedies=robot.remedies)

    def _exchange(self, request: ParamSet | None) -> ParameterExchange:
        return ParameterExchange(request, self._robot.clock.now_ns())

    async def _is_saved(self, name: str) -> bool | None:
        """Return whether the value in force survives a restart; None if unknown."""
        try:
            found = await self.fetch()
        except RemoteError:
            return None
        return next((one.saved for one in found if one.name == name), None)

    async def _hint(self, name: str, reason: int) -> str:
        """Return the values that the robot allows, by its own list; empty if unknown."""
        try:
            found = await self.fetch()
        except RemoteError:
            return ""
        return hint(found, name, reason, self._robot.remedies.parameters)


def hint(parameters: Sequence[Parameter], name: str, reason: int, remedy: str) -> str:
    """Return which values of a parameter are allowed, after a refusal; empty if unknown.

    `remedy` says how to list the parameters.
    """
    found = {one.name: one for one in parameters}
    if reason == Reason.UNKNOWN_PARAMETER:
        near = get_close_matches(name, found, n=1)
        return f"; did you mean {near[0]}?" if near else f"; see {remedy}"
    one = found.get(name)
    if one is None:
        return ""
    if reason == Reason.LESS_SAFE_THAN_CONFIGURED and one.configured is not None:
        configured = f"{number(one.configured)} {one.unit}".rstrip()
        return f"; configured: {configured}{ALLOWED.get(one.direction, '')}"
    if reason != Reason.PARAMETER_OUT_OF_RANGE or one.minimum is None or one.maximum is None:
        return ""
    limits = f"{number(one.minimum)} to {number(one.maximum)} {one.unit}"
    return f"; allowed: {limits.rstrip()}"


def nearest(names: Sequence[str], pattern: str) -> str:
    """Return the name that begins with a pattern or resembles it; empty if there is none."""
    begun = (name for name in names if name.startswith(pattern))
    return next(begun, "") or next(iter(get_close_matches(pattern, names, n=1)), "")


def number(value: float) -> str:
    """Format a value with seven digits."""
    return f"{value:.7g}"
