"""A recording as tables: `sidestep.open_recording("drive.mcap")["odometry"].to_pandas()`."""

import os
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ground.recording.catalogue import recording_named
from ground.recording.log_reader import open_log
from ground.recording.tables import TimeAxis, collect_series
from ground.recording.world_metadata import world_of
from protocol.ring import RADIUS_M
from protocol.wire.message import Message
from runtime.errors import UserError
from sidestep.simulation import World, map_of, shown
from sidestep.table import Table, Value

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Messages: TypeAlias = Iterator[tuple[float, Message]]


class Recording:
    """One recorded run: a table for each topic, the world, and a plot.

    `topics` are the names for `recording[topic]`; the last part of a name is enough, as in
    `recording["odometry"]`.
    """

    def __init__(self, path: Path, robot: str | None = None) -> None:
        self.path = path
        self._rows: dict[str, list[tuple[float, Message]]] = {}
        log = open_log(path, robot)
        for one in TimeAxis(log):
            self._rows.setdefault(one.path, []).append((one.time_s, one.message))
        self._log = log
        self.robot = log.robot
        self.damage = log.damage()
        """What is damaged in the files, in words; empty if nothing is."""

        if not self._rows:
            why = f": {self.damage}" if self.damage else ""
            raise UserError(f"{path}: holds no message of a robot{why}")
        found = world_of(log.facts.get("world", ""))
        self.world: World | None = None if found is None else shown(found)
        """The world of a simulation, if the recording has it."""

    @property
    def topics(self) -> list[str]:
        """Names of the topics in the recording."""
        return list(self._rows)

    @property
    def duration_s(self) -> float:
        """Time from the first message to the last one."""
        times_s = [time_s for rows in self._rows.values() for time_s, _ in (rows[0], rows[-1])]
        return max(times_s) - min(times_s) if times_s else 0.0

    def messages(self, topic: str) -> Messages:
        """Yield time and message of a topic, in order."""
        yield from self._rows[self._topic(topic)]

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the topics, as a mapping does."""
        return iter(self._rows)

    def __getitem__(self, topic: str) -> Table:
        return Table.of_rows(
            {"time_s": time_s, "message": type(message).__name__, **message.to_dict()}
            for time_s, message in self.messages(topic)
        )

    def _topic(self, topic: str) -> str:
        ends = [one.rpartition("/")[2] for one in self._rows]
        found = [one for one, end in zip(self._rows, ends, strict=True) if topic in (one, end)]
        if len(found) != 1:
            what = f"several topics end in {topic!r}" if found else f"there is no topic {topic!r}"
            known = (
                end if ends.count(end) == 1 else one
                for one, end in zip(self._rows, ends, strict=True)
            )
            raise UserError(f"{what}: there are {', '.join(known)}")
        return found[0]

    def to_dict(self, topic: str) -> dict[str, list[Value]]:
        """Return the columns of a topic as lists."""
        return self[topic].to_dict()

    def to_pandas(self, topic: str) -> "pd.DataFrame":
        """Return a topic as a DataFrame, with a row for each message."""
        return self[topic].to_pandas()

    def summary(self) -> Table:
        """Return a row for each topic: messages, first and last second."""
        return Table.of_rows(
            {
                "topic": topic,
                "message": ", ".join(dict.fromkeys(type(one).__name__ for _, one in rows)),
                "messages": len(rows),
                "first_s": rows[0][0],
                "last_s": rows[-1][0],
            }
            for topic, rows in self._rows.items()
        )

    def plot(self) -> "Figure":
        """Draw the map, and ranges, speeds and position error over time, with matplotlib."""
        from sidestep.plots import plot_recording  # slow import: drawing

        return plot_recording(self.path, self._log, self.world)

    def __repr__(self) -> str:
        where = "" if self.world is None else f" in {self.world.name}"
        damaged = ", damaged" if self.damage else ""
        return (
            f"<Recording {self.path.name}: {self.robot}{where}, {self.duration_s:.1f} s{damaged}>"
        )

    def _repr_html_(self) -> str:
        """Show the map with the path, and the topics, in a notebook."""
        return f"<p>{escape(repr(self))}</p>{self._map()}{self.summary()._repr_html_()}"

    def _map(self) -> str:
        """Draw the path in its world; empty without a world."""
        if self.world is None:
            return ""
        series = collect_series(TimeAxis(open_log(self.path)), RADIUS_M)
        drawn = map_of(self.world)
        for path, kind in ((series.true, "way l-vgm_memory"), (series.estimated, "believed")):
            drawn.drawing.polyline([drawn.at((x_m, y_m)) for x_m, y_m, _ in path], kind)
        return drawn.drawing.alone()


def open_recording(
    path: str | os.PathLike[str] | None = None, *, robot: str | None = None
) -> Recording:
    """Read a recording: an .mcap or .tlog file, or without a path the newest one of this user.

    `robot` is needed if the name of the file does not contain it. Raises ValueError (UserError) for
    a file that is none, and for one without any message that can be read.
    """
    return Recording(recording_named(None if path is None else os.fspath(path)), robot)
