"""Show the Links screen: streams of all robots, and processes, loss and lease of the selected."""

from ground.app.lists.link_columns import COLUMNS, LinkRow, link_rows
from ground.app.lists.table import Table
from ground.app.panels.aged import MISSING, number, role_of
from ground.app.panels.board import board_details
from ground.app.panels.cycle import cycle_rows
from ground.app.panels.status import stop_role
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.list_screen import ListScreen
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.client.telemetry import Age
from ground.station.station import Station
from protocol.topics import CYCLE, GATEWAY, Role
from protocol.wire.messages import GatewayStatus
from runtime.units import NS_PER_S

ROLES = (Role.ROBOT, Role.PLANT, Role.GROUND)
LOSS_PERMILLE = 10
"""A loss of this many frames of 1000 from MAVLink clients is shown in another colour."""


class LinksScreen(ListScreen[LinkRow]):
    """The list of streams, with the state of the selected robot's link."""

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface, Table(COLUMNS, key=lambda one: (one.robot.robot, one.name)))

    def draw(self) -> None:
        """Draw the streams and the link."""
        station = self.interface.station
        rows = link_rows(station)
        robots = sum(one.stream is None for one in rows)
        words = f" {robots} robot{'' if robots == 1 else 's'}, {len(rows) - robots} streams"
        self.draw_rows(rows, row(words))
        about = self.lines("about")
        cycle = cycle_rows(station.seen(CYCLE), station.worst_cycle)
        rejection = rejection_rows(self.chosen)
        link = [*rejection, *process_rows(station), *link_lines(station), *cycle]
        link += board_details(station)
        about.styles.height = len(link) + 1
        about.show(link)


def rejection_rows(one: LinkRow | None) -> list[Row]:
    """Return why the last rejected frame of a stream was rejected, if there is one."""
    stream = None if one is None else one.stream
    if stream is None or not stream.last_rejection:
        return []
    return [
        row(head(" reject  "), f"{stream.topic.path}: ", Span(stream.last_rejection, "caution"))
    ]


def process_rows(station: Station) -> list[Row]:
    """Return the processes of the robot in a row, and a row for each that was restarted."""
    present, robot = station.present, station.robot
    spans = [head(f" {robot:<8}")]
    for role in ROLES:
        there = present.has(robot, role)
        well = (stop_role(station) if role is Role.ROBOT else "") or "ok"
        mark = Span("● present  ", well) if there else Span("○ missing  ", "danger")
        spans += [Span(f"{role.value} "), mark]
    restarts = [(role, restart_words(station, role)) for role in ROLES]
    return [
        tuple(spans),
        *(
            row(head(f" {role.value:<8}"), Span(words, "caution"))
            for role, words in restarts
            if words
        ),
    ]


def restart_words(station: Station, role: Role) -> str:
    """Return how often a process was restarted, and the cause of the last restart."""
    times = station.restarts(role)
    words = [f"restarted {times} {'time' if times == 1 else 'times'}"] if times else []
    if role is Role.ROBOT and station.restart_cause:
        words.append(station.restart_cause)
    return "; ".join(words)


def link_lines(station: Station) -> list[Row]:
    """Return loss, delivered frames, round trip, lease and the last command."""
    loss, lease = station.loss(), station.lease
    lost = Span(loss.banner(station.now_ns), "danger") if loss else Span("none", "ok")
    left = f", {lease.lapses_s:.0f} s left" if lease.held else ""
    drove = f", last driver {lease.driver}" if lease.driver else ""
    return [
        row(head(" loss    "), lost),
        row(
            head(" frames  "), f"{number(station.link_percent, '.1f')} % delivered",
            head("   round trip "), f"{number(station.round_trip_ms, '.0f')} ms",
        ),
        row(
            head(" lease   "), Span(lease.words, "caution" if lease.others else "text"),
            faint(left + drove),
        ),
        row(head(" last    "), station.last_command or faint(MISSING)),
        *gateway_rows(station),
    ]  # fmt: skip


def gateway_rows(station: Station) -> list[Row]:
    """Return the state of the MAVLink gateway, or its loss; no rows if none was seen."""
    seen = station.seen(GATEWAY)
    status = seen.message
    if seen.age_ns is None or not isinstance(status, GatewayStatus):
        return []
    if seen.age is Age.GONE:
        words = (
            f"no data for {seen.age_ns / NS_PER_S:.0f} s: the gateway has ended, is slow or hangs"
        )
        return [row(head(" mavlink "), Span(words, "caution"))]
    owner = f", {status.owner} commands" if status.owner else ""
    is_bad = status.lost_permille >= LOSS_PERMILLE or bool(status.refused)
    return [
        row(
            head(" mavlink "),
            Span(
                f"system {status.system}: {status.clients} client"
                f"{'' if status.clients == 1 else 's'} ({status.signing} signed){owner}",
                role_of(seen),
            ),
        ),
        row(
            faint(
                f"         in {status.received_hz} Hz, out {status.sent_bytes_s / 1000:.1f} kB/s"
            ),
            Span(
                f"   {status.lost_permille / 10:.1f} % lost, {status.refused} refused",
                role_of(seen, "caution" if is_bad else "text"),
            ),
        ),
    ]
