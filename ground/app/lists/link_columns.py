"""Define the rows and columns of the Links screen: each robot, and each of its streams."""

from typing import Final, NamedTuple

from ground.app.lists.table import Column
from ground.app.panels.aged import number
from ground.app.panels.streams import ROLES, age, rate
from ground.station.fleet import RosterEntry
from ground.station.link.streams import StreamRow
from ground.station.station import Station

LOSS: Final = 1.0
"""A loss of this percentage is shown in another colour."""
WHOLE: Final = "(all frames)"


class LinkRow(NamedTuple):
    """A stream of a robot, or all its frames when `stream` is None."""

    robot: RosterEntry
    stream: StreamRow | None = None

    @property
    def name(self) -> str:
        """Name of the stream."""
        return WHOLE if self.stream is None else self.stream.topic.path

    @property
    def lost_percent(self) -> float | None:
        """Percentage of frames that were lost in the last seconds; None without any frame."""
        if self.stream is not None:
            return self.stream.lost_percent if self.stream.received else None
        percent = self.robot.link_percent
        return None if percent is None else 100.0 - percent

    @property
    def round_trip_ms(self) -> float | None:
        """Round trip of a request to the robot; None in rows of streams."""
        return self.robot.round_trip_ms if self.stream is None else None

    @property
    def role(self) -> str:
        """The role of live values."""
        return "text" if self.stream is None else ROLES[self.stream.age]


def link_rows(station: Station) -> list[LinkRow]:
    """Return a row for each robot and each of its streams, those without a frame last."""
    rows: list[LinkRow] = []
    for entry in sorted(station.roster(links=True), key=lambda entry: not entry.is_selected):
        streams = station.streams(entry.robot)
        rows.append(LinkRow(entry))
        rows += [LinkRow(entry, one) for one in streams if one.received]
        rows += [LinkRow(entry, one) for one in streams if not one.received]
    return rows


def lost_role(one: LinkRow) -> str:
    """Return the role of a loss."""
    return "caution" if (one.lost_percent or 0.0) >= LOSS else "faint"


def rejected_role(one: LinkRow) -> str:
    """Return the role of the number of rejected frames."""
    return "caution" if one.stream and one.stream.rejected else "faint"


COLUMNS: Final = (
    Column[LinkRow]("robot", 6, lambda one: one.robot.robot, role=lambda _: "head"),
    Column[LinkRow]("stream", 13, lambda one: one.name, role=lambda one: one.role),
    Column[LinkRow](
        "expected", 4,
        lambda one: f"{one.stream.topic.rate_hz:g}" if one.stream and one.stream.topic.rate_hz
        else "",
        lambda one: one.stream.topic.rate_hz if one.stream else None,
        lambda _: "faint", numeric=True, short="due",
    ),
    Column[LinkRow](
        "got", 6, lambda one: rate(one.stream) if one.stream else "",
        lambda one: one.stream.rate_hz if one.stream else None,
        lambda one: one.role, unit="Hz", numeric=True,
    ),
    Column[LinkRow](
        "age", 6, lambda one: age(one.stream) if one.stream else "",
        lambda one: one.stream.age_ns if one.stream else None,
        lambda one: one.role, numeric=True,
    ),
    Column[LinkRow](
        "loss", 7, lambda one: number(one.lost_percent, ".1f"), lambda one: one.lost_percent,
        lost_role, unit="%", numeric=True,
    ),
    Column[LinkRow](
        "lost", 5, lambda one: str(one.stream.lost) if one.stream else "",
        lambda one: one.stream.lost if one.stream else None, lost_role, numeric=True,
    ),
    Column[LinkRow](
        "trip", 7, lambda one: number(one.round_trip_ms, ".0f") if one.stream is None else "",
        lambda one: one.round_trip_ms, unit="ms", numeric=True,
    ),
    Column[LinkRow](
        "frames", 6, lambda one: str(one.stream.received) if one.stream else "",
        lambda one: one.stream.received if one.stream else None, numeric=True,
    ),
    Column[LinkRow](
        "rejected", 6, lambda one: str(one.stream.rejected) if one.stream else "",
        lambda one: one.stream.rejected if one.stream else None, rejected_role,
        numeric=True, short="reject",
    ),
    Column[LinkRow](
        "why", 0, lambda one: one.stream.last_rejection if one.stream else "", role=rejected_role
    ),
)  # fmt: skip
