"""The robot's parameters: read all or some of them, set one or several."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from math import isfinite, nan
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final

from ground.client import parameter_file
from ground.client.link import Link, UnansweredError
from ground.client.outcomes import Refused, Success
from ground.client.parameter import Parameter, line, parameters_in, same
from ground.client.parameter_rows import NAME_RULE
from ground.client.requests import Exchange, GaveUp, is_saving
from ground.client.session import Session, refusing_holder
from ground.client.vocabulary import value_words
from protocol.topics import PARAMETER, PARAMETERS
from protocol.wire.enums import PARAM_TYPE_REAL32
from protocol.wire.limits import MAX_PARAMETER_NAME_BYTES
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, ParamSet, ParamValue
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError, UserError

SAVING_NS: Final = 15_000_000_000
"""Time limit, longer than the robot waits for its disk before it answers NOT_SAVED."""
NO_CHANGE: Final = "no change: the robot has all values of the file"

SAVED: Final[Mapping[bool | None, str]] = MappingProxyType(
    {
        True: "saved on the robot",
        False: "in force until the robot restarts: without --state DIR it saves nothing",
        None: "in force; the robot does not report whether it is saved",
    }
)
COLUMNS: Final = ("name", "value", "unit", "minimum", "maximum", "default", "safer", "doc")
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


def ask(link: Link, request: ParamSet | None) -> Message | bytes:
    """Return the robot's reply; UnansweredError names the process that is missing."""
    exchange = ParameterExchange(request, link.clock.now_ns())
    link.exchange(exchange, PARAMETERS if request is None else PARAMETER)
    outcome = exchange.outcome
    if outcome is None or isinstance(outcome, GaveUp):
        why = "no answer" if outcome is None else outcome.why
        raise UnansweredError(f"{link.diagnosis()} ({why})")
    return outcome


def fetch(link: Link) -> list[Parameter]:
    """Return the robot's parameters; RemoteError if the list is missing or malformed."""
    answer = ask(link, None)
    if not isinstance(answer, bytes):
        raise RemoteError("the robot's reply is not a parameter list")
    return parameters_in(answer)


@dataclass(frozen=True, slots=True)
class ParameterTable(Success):
    """Some parameters of the robot; `wide` shows all facts about each, else its value."""

    parameters: tuple[Parameter, ...]
    wide: bool = True

    @property
    def text(self) -> str:
        """A table, or one line per parameter."""
        if not self.parameters:
            return "all parameters have their default values"
        return table(self.parameters) if self.wide else "\n".join(map(line, self.parameters))

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return all that the robot sent about each parameter."""
        return {"parameters": [one.as_json() for one in self.parameters]}


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowParameters:
    """Read the parameters whose names match a pattern such as `sonar_*`.

    `only_changed` selects those that differ from their defaults, perhaps none.
    """

    moves: ClassVar[bool] = False
    pattern: str = "*"
    wide: bool = True
    only_changed: bool = False

    @property
    def verb(self) -> str:
        """The verb, by whether the table is wide."""
        return "param list" if self.wide else "param get"

    def perform(self, session: Session) -> ParameterTable:
        """Return the parameters; UserError if no name matches."""
        found = fetch(session.link)
        chosen = tuple(one for one in found if fnmatchcase(one.name, self.pattern))
        if self.only_changed:
            return ParameterTable(tuple(one for one in chosen if not one.is_default))
        if not chosen:
            near = nearest([one.name for one in found], self.pattern)
            parameters = session.link.common.remedies.parameters
            remedy = f"did you mean {near!r}?" if near else parameters
            raise UserError(f"no parameter matches {self.pattern!r}: {remedy}")
        return ParameterTable(chosen, self.wide)


def nearest(names: Sequence[str], pattern: str) -> str:
    """Return the name that begins with a pattern or resembles it; empty if there is none."""
    begun = (name for name in names if name.startswith(pattern))
    return next(begun, "") or next(iter(get_close_matches(pattern, names, n=1)), "")


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


@dataclass(frozen=True, slots=True, kw_only=True)
class SetParameter:
    """Set one parameter, in its own unit; a robot with --state saves it."""

    verb: ClassVar[str] = "param set"
    moves: ClassVar[bool] = True
    name: str
    value: float

    def __post_init__(self) -> None:
        if not self.name or len(self.name) > MAX_PARAMETER_NAME_BYTES or not self.name.isascii():
            raise UserError(f"{self.name!r} is not a valid parameter name: {NAME_RULE}")

    def perform(self, session: Session) -> ParameterChanged:
        """Set the value and read back whether it is saved."""
        link = session.link
        found = set_value(link, self.name, self.value)
        if isinstance(found, Refused):
            refused = replace(found, holder=refusing_holder(link, found.reason))
            return ParameterChanged(
                name=self.name,
                asked=self.value,
                now=None,
                refusal=refused.words + hint(link, self.name, found.reason),
                reason=found.reason,
            )
        changed = ParameterChanged(name=self.name, asked=self.value, now=found)
        return replace(changed, saved=is_saved(link, self.name))


@dataclass(frozen=True, slots=True, kw_only=True)
class ResetParameter:
    """Set one parameter to its default value."""

    verb: ClassVar[str] = "param reset"
    moves: ClassVar[bool] = True
    name: str

    def perform(self, session: Session) -> ParameterChanged:
        """Read the default and set it; UserError for an unknown parameter."""
        parameters = session.link.common.remedies.parameters
        value = default_of(fetch(session.link), self.name, parameters)
        return SetParameter(name=self.name, value=value).perform(session)


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


@dataclass(frozen=True, slots=True, kw_only=True)
class SaveParameters:
    """Write the parameters that differ from their defaults to a file.

    Without a file, list those that the robot saves by itself.
    """

    verb: ClassVar[str] = "param save"
    moves: ClassVar[bool] = False
    file: Path | None = None

    def perform(self, session: Session) -> ParametersSaved:
        """Write the file, or list the names."""
        found = fetch(session.link)
        if self.file is None:
            return ParametersSaved(tuple(one.name for one in found if one.saved))
        return ParametersSaved(tuple(parameter_file.write(self.file, found)), self.file)


@dataclass(frozen=True, slots=True)
class ParametersLoaded:
    """The parameters that were set, with the values before, and the refusal that ended it."""

    before: tuple[tuple[str, float], ...]
    refusal: str = ""

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
        return f"{self.refusal}; {done}" if self.refusal else done

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return names and refusal as a row."""
        return {"verb": "param load", "ok": self.ok, "set": [*self.names], "reason": self.refusal}


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadParameters:
    """Set all values of a file; set none unless all of them are allowed (ConfigError)."""

    verb: ClassVar[str] = "param load"
    moves: ClassVar[bool] = True
    file: Path

    def perform(self, session: Session) -> ParametersLoaded:
        """Set the values that differ, until one is refused."""
        found = fetch(session.link)
        return set_values(session.link, found, parameter_file.read(self.file, found))


def set_values(
    link: Link, found: Sequence[Parameter], wanted: Mapping[str, float]
) -> ParametersLoaded:
    """Set the values that differ from those found, until one is refused."""
    values = {one.name: one.value for one in found}
    done: list[tuple[str, float]] = []
    for name, value in wanted.items():
        if same(before := values.get(name, nan), value):
            continue
        answer = set_value(link, name, value)
        if isinstance(answer, Refused):
            refused = replace(answer, holder=refusing_holder(link, answer.reason))
            refusal = f"refused: {name} = {number(value)}: {refused.words}"
            return ParametersLoaded(tuple(done), refusal)
        done.append((name, before))
    return ParametersLoaded(tuple(done))


def set_value(link: Link, name: str, value: float) -> float | Refused:
    """Set one parameter; return the value that is in force now, or the refusal."""
    asked_ns = link.clock.now_ns()
    answer = ask(link, ParamSet(param_id=name, param_value=value, param_type=PARAM_TYPE_REAL32))
    if isinstance(answer, ParamValue):
        return float(answer.param_value)
    took_ns = link.clock.now_ns() - asked_ns
    reason = answer.result_param2 if isinstance(answer, CommandAck) else Reason.MALFORMED
    return Refused(reason, took_ns, remedies=link.common.remedies)


def is_saved(link: Link, name: str) -> bool | None:
    """Return whether the value in force survives a restart; None if unknown."""
    try:
        found = fetch(link)
    except RemoteError:
        return None
    return next((one.saved for one in found if one.name == name), None)


def default_of(parameters: Sequence[Parameter], name: str, remedy: str) -> float:
    """Return a default; UserError if the robot has no such parameter or no default for it.

    `remedy` says how to list the parameters.
    """
    defaults = {one.name: one.default for one in parameters}
    value = defaults.get(name)
    if value is None:
        near = get_close_matches(name, defaults, n=1)
        fix = f"did you mean {near[0]}?" if near else remedy
        raise UserError(f"no parameter {name!r} with a default: {fix}")
    return value


def hint(link: Link, name: str, reason: int) -> str:
    """Return the values that the robot allows, by its own list; empty if unknown."""
    try:
        found = {one.name: one for one in fetch(link)}
    except RemoteError:
        return ""
    if reason == Reason.UNKNOWN_PARAMETER:
        near = get_close_matches(name, found, n=1)
        return f"; did you mean {near[0]}?" if near else f"; see {link.common.remedies.parameters}"
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


def table(parameters: Sequence[Parameter]) -> str:
    """Format columns of minimal width; mark values that differ from the default with `*`."""
    cells = [list(COLUMNS), *map(cells_of, parameters)]
    widths = [max(len(one[at]) for one in cells) for at in range(len(COLUMNS))]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(one, widths, strict=True)).rstrip()
        for one in cells
    )


def cells_of(one: Parameter) -> list[str]:
    """Return the cells of one row, in the order of COLUMNS."""
    mark = "" if one.value == one.default else " *"
    value, limits = value_words(one.name, one.value) + mark, (one.minimum, one.maximum)
    numbers = ["" if limit is None else number(limit) for limit in limits]
    default = "" if one.default is None else value_words(one.name, one.default)
    return [one.name, value, one.unit, *numbers, default, one.direction, one.doc]


def number(value: float) -> str:
    """Format a value with seven digits."""
    return f"{value:.7g}"
