"""Show the Links screen: processes, streams, rates, loss, round trip, restarts, and the lease."""

from typing import ClassVar

from textual.app import ComposeResult

from ground.app.panels.aged import MISSING, number
from ground.app.panels.streams import long, long_head
from ground.app.screens.list_screen import ScrolledScreen
from ground.app.widgets.log_view import LogView
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.station.station import Station
from protocol.topics import Role


class LinksScreen(ScrolledScreen):
    """The state of all connections, in lines that scroll."""

    focus_first: ClassVar[str] = "#lines"

    def compose_content(self) -> ComposeResult:
        """Compose the lines."""
        yield LogView(id="lines")

    def on_mount(self) -> None:
        """Show the first line first."""
        self.list_view.following = False
        super().on_mount()

    @property
    def list_view(self) -> LogView:
        """The lines."""
        return self.query_one(LogView)

    def draw(self) -> None:
        """Draw the lines in sight."""
        self.list_view.window(link_rows(self.interface.station), lambda row: row)


def link_rows(station: Station) -> list[Row]:
    """Return all rows."""
    streams = [line for line in station.streams() if line.received]
    silent = [line.topic.path for line in station.streams() if not line.received]
    return [
        *process_rows(station),
        (),
        *link_lines(station),
        (),
        row(" ", long_head()),
        *(row(" ", *long(line)) for line in streams),
        row(head(" silent  "), faint(", ".join(silent) or "none")),
    ]


def process_rows(station: Station) -> list[Row]:
    """Return a row for each process of the robot, and the other robots."""
    present, robot = station.present, station.robot
    rows: list[Row] = []
    for role in (Role.ROBOT, Role.PLANT, Role.GROUND):
        there = present.has(robot, role)
        mark = Span("● present  ", "ok") if there else Span("○ missing  ", "danger")
        rows.append(
            row(head(f" {role.value:<8}"), mark, Span(restart_words(station, role), "caution"))
        )
    others = [name for name in station.robots() if name != robot]
    if others:
        rows.append(row(head(" others  "), ", ".join(others)))
    return rows


def restart_words(station: Station, role: Role) -> str:
    """Return how often a process was restarted, and the cause of the last restart."""
    times = station.restarts(role)
    words = [f"restarted {times} {'time' if times == 1 else 'times'}"] if times else []
    if role is Role.ROBOT and station.restart_cause:
        words.append(station.restart_cause)
    return "; ".join(words)


def link_lines(station: Station) -> list[Row]:
    """Return loss, received frames, round trip, lease and the last command."""
    loss, lease = station.loss(), station.lease
    lost = Span(loss.banner(station.now_ns), "danger") if loss else Span("none", "ok")
    left = f", expires after {lease.lapses_s:.1f} s without a heartbeat" if lease.held else ""
    return [
        row(head(" loss    "), lost),
        row(head(" received"), f" {number(station.link_percent, '.1f')} % of the robot's frames"),
        row(head(" ping    "), f"{number(station.round_trip_ms, '.0f')} ms round trip"),
        row(
            head(" lease   "), Span(lease.words, "caution" if lease.others else "text"), faint(left)
        ),
        row(head(" last    "), station.last_command or faint(MISSING)),
    ]
