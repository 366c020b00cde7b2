"""The outcome of a report: a text for a person, and a row for programs."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Report:
    """The outcome of a report; `ok` if all could be read and no fault was found."""

    ok: bool
    text: str
    row: Mapping[str, object] = field(default_factory=dict)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the row."""
        return dict(self.row)
