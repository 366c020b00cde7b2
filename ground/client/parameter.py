"""One parameter of the robot as a typed value, read from the robot's parameter list."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isclose

from ground.client.parameter_rows import rows_in
from ground.client.vocabulary import value_words


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter as the robot describes it; None for what the robot leaves out.

    `value`, `default`, `minimum`, `maximum` and `configured` are in `unit`. `direction` is the
    safer direction: up, down or near; empty if no safety function depends on the parameter.
    `saved`: the value survives a restart. `received` holds all that the robot sent, for output as
    JSON.
    """

    name: str
    value: float
    default: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    configured: float | None = None
    unit: str = ""
    direction: str = ""
    doc: str = ""
    integer: bool = False
    saved: bool | None = None
    received: Mapping[str, object] = field(default_factory=dict, compare=False, repr=False)

    @property
    def is_default(self) -> bool:
        """True if it has its default value, to the precision of the wire."""
        return self.default is None or same(self.value, self.default)

    def with_value(self, value: float) -> "Parameter":
        """Return a copy with another value."""
        return replace(self, value=value, received={**self.received, "value": value})

    def as_json(self) -> dict[str, object]:
        """Return all that the robot sent about it."""
        return dict(self.received)


def same(one: float, other: float) -> bool:
    """Return whether two values are equal to the wire's single precision."""
    return isclose(one, other, rel_tol=1e-6, abs_tol=1e-9)


def parameters_in(answer: bytes | str) -> list[Parameter]:
    """Parse the robot's parameter list; RemoteError names the first fault."""
    return [_parameter(row) for row in rows_in(answer)]


def _parameter(row: Mapping[str, object]) -> Parameter:
    """Convert a row whose types `rows_in` has checked."""
    numbers = {
        key: value
        for key in ("default", "minimum", "maximum", "configured")
        if isinstance(value := row.get(key), int | float) and not isinstance(value, bool)
    }
    texts = {key: str(row[key]) for key in ("unit", "direction", "doc") if key in row}
    saved, value = row.get("saved"), row["value"]
    assert isinstance(value, int | float), "rows_in has checked it"
    return Parameter(
        name=str(row["name"]),
        value=value,
        default=numbers.get("default"),
        minimum=numbers.get("minimum"),
        maximum=numbers.get("maximum"),
        configured=numbers.get("configured"),
        unit=texts.get("unit", ""),
        direction=texts.get("direction", ""),
        doc=texts.get("doc", ""),
        integer=row.get("integer") is True,
        saved=saved if isinstance(saved, bool) else None,
        received=row,
    )


def line(parameter: Parameter) -> str:
    """Format a parameter as NAME = VALUE UNIT."""
    unit = f" {parameter.unit}" if parameter.unit else ""
    return f"{parameter.name} = {value_words(parameter.name, parameter.value)}{unit}"
