"""Show the Links screen: streams of all robots, and processes, loss and lease of the selected.

It also shows the cost of the control cycle and of its stages.
"""

from typing import Final, NamedTuple

from ground.app.app_interface import AppInterface
from ground.app.lists.table import Column, Table
from ground.app.panels.aged import MISSING, aged, live, number, role_of
from ground.app.panels.robot_state import board_details
from ground.app.panels.status import stop_role
from ground.app.screens.list_screen import ListScreen
from ground.app.widgets.bars import bar
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.client.telemetry import Age, AgedMessage
from ground.station.fleet import RosterEntry
from ground.station.link.streams import StreamRow
from ground.station.station import Station
from protocol.topics import CYCLE, GATEWAY, Role
from protocol.wire.messages import CycleReport, GatewayStatus
from runtime.units import NS_PER_S

STAGES: Final = ("read", "odometry", "navigate", "guard", "write")
BAR: Final = 8


def cycle_rows(seen: AgedMessage, report: CycleReport | None) -> list[Row]:
    """Return the most expensive control cycle of the last second, and its stages.

    The cost is compared with the budget; stages are in microseconds.
    """
    if live(seen) is None or report is None:
        return [row(head(" cycle   "), aged(seen, lambda _: ""))]
    spent, budget = sum(report.stage_us), report.budget_us
    over = "danger" if spent > budget else "mission"
    gauge = Span(bar(spent / budget if budget else 1.0, BAR), role_of(seen, over))
    marks = Span(" over budget" if spent > budget else "", "danger")
    stages = zip(STAGES, report.stage_us, strict=True)
    shares = (piece for name, us in stages for piece in (head(f"{name} "), Span(f"{us}  ")))
    return [
        row(
            head(" cycle   "), gauge, f" {spent} of {budget} us", marks,
            f", {report.late_us / 1000:.2f} ms late, {report.missed} missed",
        ),
        row(head("   of it "), *shares),
    ]  # fmt: skip


STREAM_ROLES: Final = {Age.LIVE: "text", Age.DIM: "faint", Age.GONE: "faint"}


def rate(line: StreamRow) -> str:
    """Return the rate in Hz as text, or "event" for a topic without a fixed rate."""
    if not line.topic.rate_hz:
        return "event"
    return MISSING if line.age is Age.GONE else number(line.rate_hz, ".0f")


def age(line: StreamRow) -> str:
    """Return the age as text.

    A live topic has a word, because a number that changes with every frame is unreadable.
    """
    if line.age_ns is None:
        return MISSING
    if not line.topic.rate_hz:
        return f"{line.age_ns / NS_PER_S:.0f} s"
    return "live" if line.age is Age.LIVE else f"{line.age_ns / NS_PER_S:.1f} s"


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
        return "text" if self.stream is None else STREAM_ROLES[self.stream.age]


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
    body = Role.DRIVER if present.has(robot, Role.DRIVER) else Role.PLANT
    roles = (Role.ROBOT, body, Role.GROUND)
    for role in roles:
        there = present.has(robot, role)
        well = (stop_role(station) if role is Role.ROBOT else "") or "ok"
        mark = Span("● present  ", well) if there else Span("○ missing  ", "danger")
        spans += [Span(f"{role.value} "), mark]
    restarts = [(role, restart_words(station, role)) for role in roles]
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
        row(head(" last    "), station.queue.last or faint(MISSING)),
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
