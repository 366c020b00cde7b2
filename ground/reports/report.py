"""The outcome of a report: a text for a person, and a row for programs."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Report:
    """`ok`: all could be read and is well."""

    ok: bool
    text: str
    row: Mapping[str, object] = field(default_factory=dict)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        return dict(self.row)
