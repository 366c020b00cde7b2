"""The robot's parameters: read all or some of them, set one or several."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Final

from ground.client.outcomes import Refused, Success
from ground.client.parameter import Parameter, line
from ground.client.parameter_rows import NAME_RULE
from ground.client.parameters import ParameterChanged, ParametersLoaded, ParametersSaved, number
from ground.client.vocabulary import value_words
from ground.robot import Robot
from protocol.wire.limits import MAX_PARAMETER_NAME_BYTES
from runtime.errors import UserError

COLUMNS: Final = ("name", "value", "unit", "minimum", "maximum", "default", "safer", "doc")


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

    async def perform(self, robot: Robot) -> ParameterTable:
        """Return the parameters; UserError if no name matches."""
        parameters = robot.parameters
        if self.only_changed:
            return ParameterTable(await parameters.changed())
        return ParameterTable(await parameters.list(self.pattern), self.wide)


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

    async def perform(self, robot: Robot) -> ParameterChanged | Refused:
        """Set the value and read back whether it is saved."""
        return await robot.parameters.change(self.name, self.value)


@dataclass(frozen=True, slots=True, kw_only=True)
class ResetParameter:
    """Set one parameter to its default value."""

    verb: ClassVar[str] = "param reset"
    moves: ClassVar[bool] = True
    name: str

    async def perform(self, robot: Robot) -> ParameterChanged | Refused:
        """Read the default and set it; UserError for an unknown parameter."""
        return await robot.parameters.reset(self.name)


@dataclass(frozen=True, slots=True, kw_only=True)
class SaveParameters:
    """Write the parameters that differ from their defaults to a file.

    Without a file, list those that the robot saves by itself.
    """

    verb: ClassVar[str] = "param save"
    moves: ClassVar[bool] = False
    file: Path | None = None

    async def perform(self, robot: Robot) -> ParametersSaved:
        """Write the file, or list the names."""
        return await robot.parameters.save(self.file)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadParameters:
    """Set all values of a file; set none unless all of them are allowed (ConfigError)."""

    verb: ClassVar[str] = "param load"
    moves: ClassVar[bool] = True
    file: Path

    async def perform(self, robot: Robot) -> ParametersLoaded | Refused:
        """Set the values that differ, until one is refused."""
        return await robot.parameters.load(self.file)


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
