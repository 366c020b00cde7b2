"""`param`: read the robot's parameters, set one or several."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from ground.client.outcomes import Refused, Success
from ground.client.parameter import Parameter, line
from ground.client.parameter_file import ENDINGS
from ground.client.parameter_rows import NAME_RULE
from ground.client.parameters import ParameterChanged, ParametersLoaded, ParametersSaved, number
from ground.client.vocabulary import value_in_words, value_words
from ground.commands.command import Group, OperatorCommand, command, place
from ground.robot import Robot
from protocol.wire.limits import MAX_PARAMETER_NAME_BYTES
from runtime.cli.verb import MORE
from runtime.errors import UserError

PARAM: Final = Group(
    MORE, 10, "param set d_obs_m 0.35", "read and set the robot's parameters", suffixes=ENDINGS
)
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


@command(PARAM, example="param list")
class ShowParameters(OperatorCommand):
    """All parameters, with unit, range, default and meaning.

    With a `pattern` such as `sonar_*` those whose names match.
    """

    pattern: str = place("GLOB", default="*")

    async def perform(self, robot: Robot) -> ParameterTable:
        """Return the parameters; UserError if no name matches."""
        return ParameterTable(await robot.parameters.list(self.pattern))


@command(PARAM, example="param get 'sonar_*'", also=("get",))
class ShowValues(OperatorCommand):
    """Parameters whose name matches, as in 'sonar_*'."""

    pattern: str = place("GLOB")

    async def perform(self, robot: Robot) -> ParameterTable:
        """Return the parameters; UserError if no name matches."""
        return ParameterTable(await robot.parameters.list(self.pattern), wide=False)


@command(PARAM, example="param diff --json")
class ShowChanged(OperatorCommand):
    """Parameters that differ from their defaults."""

    async def perform(self, robot: Robot) -> ParameterTable:
        """Return the parameters, perhaps none."""
        return ParameterTable(await robot.parameters.changed())


@command(PARAM, example="param set d_obs_m 0.35", moves=True, short="set")
class SetParameter(OperatorCommand):
    """Set one parameter; a robot with --state saves it."""

    name: str = place("NAME")
    value: float = place("VALUE", "a number, or a name such as bug or left", spelt=repr)

    def __post_init__(self) -> None:
        if not self.name or len(self.name) > MAX_PARAMETER_NAME_BYTES or not self.name.isascii():
            raise UserError(f"{self.name!r} is not a valid parameter name: {NAME_RULE}")

    @classmethod
    def parsed(cls, found: Any) -> Self:
        """Return the command for parsed arguments; UserError for a value without a meaning."""
        return cls(name=found.name, value=value_in_words(found.name, found.value))

    async def perform(self, robot: Robot) -> ParameterChanged | Refused:
        """Set the value and read back whether it is saved."""
        return await robot.parameters.change(self.name, self.value)


@command(PARAM, example="param reset d_obs_m", moves=True)
class ResetParameter(OperatorCommand):
    """Set one parameter to its default value."""

    name: str = place("NAME")

    async def perform(self, robot: Robot) -> ParameterChanged | Refused:
        """Read the default and set it; UserError for an unknown parameter."""
        return await robot.parameters.reset(self.name)


@command(PARAM, example="param save tuned.toml")
class SaveParameters(OperatorCommand):
    """Write the changed parameters to a .toml or .param file.

    Without a file, list those that the robot saves by itself.
    """

    file: Path | None = place(
        "FILE", "without it, list what the robot saves by itself", default=None, parse=Path
    )

    async def perform(self, robot: Robot) -> ParametersSaved:
        """Write the file, or list the names."""
        return await robot.parameters.save(self.file)


@command(PARAM, example="param load tuned.toml", moves=True)
class LoadParameters(OperatorCommand):
    """Set all values of a file, if all are allowed.

    ConfigError if one is not: then none is set.
    """

    file: Path = place("FILE", ".toml with [parameters], or .param", parse=Path)

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
