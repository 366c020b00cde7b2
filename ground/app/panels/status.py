"""Make the status line: the most important parts first, because the last ones are cut off."""

from typing import Final, NamedTuple

from ground.app.panels.aged import MISSING, aged, live, number, role_of
from ground.app.widgets.rows import Row, Span, cut, faint, head, row, width_of
from ground.client.status_line import PLACE_UNKNOWN, name_of
from ground.client.telemetry import Age, AgedMessage
from ground.client.vocabulary import NAVIGATORS, SIDES
from ground.station.station import Station
from ground.text.wording import CAUTION, DANGER, OK, vehicle_role
from protocol.topics import HEARTBEAT, STATUS
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.messages import NavigatorStatus

SIMULATION: Final = "SIM"
GAP: Final = Span("  ", "text")
TIGHT: Final = Span(" ", "text")
CRUMB: Final = " ▸ "
LEAST_FOR_CRUMBS: Final = 40
"""On fewer columns, the steps of the path are separated by a space."""
NAMES: Final[dict[int, str]] = {number: name for name, number in NAVIGATORS.items()}
SIDE_NAMES: Final[dict[int, str]] = {number: name for name, number in SIDES.items()}


class SessionInfo(NamedTuple):
    """The facts that the status line shows besides the robot's state."""

    kind: str = "REAL"
    recording: str = ""
    hint: str = ""
    """Why simulated time is slower than chosen; empty while it is not."""


def status_row(station: Station, session: SessionInfo, width: int) -> Row:
    """Return the status line; narrow the gaps, then drop the last parts, until it fits."""
    crumb = CRUMB if width >= LEAST_FOR_CRUMBS else TIGHT.text
    parts = [part for part in parts_of(station, session, crumb) if width_of(part)]
    gap = GAP
    if _wide(parts, gap) > width:
        gap = TIGHT
    while len(parts) > 1 and _wide(parts, gap) > width:
        parts.pop()
    spans: list[Span] = []
    for part in parts:
        spans += [gap, *part] if spans else part
    return cut(row(*spans), width)


def _wide(parts: list[Row], gap: Span) -> int:
    return sum(map(width_of, parts)) + len(gap.text) * (len(parts) - 1)


def parts_of(station: Station, session: SessionInfo, crumb: str) -> list[Row]:
    """Return the parts of the status line, the most important first.

    The first is the path from the robot to its state, with `crumb` between the steps.
    """
    status = station.seen(STATUS)
    kind = kind_part(session)
    return [
        row(presence(station), Span(f" {station.robot}", "accent"), *state_spans(status, crumb)),
        row(Span(PLACE_UNKNOWN if station.place_remedy else "", "danger")),
        row(aged(status, navigator_words)) if live(status) else (),
        kind if session.hint else (),
        link_part(station),
        () if session.hint else kind,
        row(Span(session.recording, "danger" if session.recording.endswith("!") else "ok")),
        lease_part(station),
    ]


def state_spans(status: AgedMessage, crumb: str) -> Row:
    """Return mode and vehicle behind the robot, or only the age when they are too old."""
    mode = aged(status, mode_words)
    if live(status) is None:
        return row(faint(crumb), mode)
    vehicle = aged(status, vehicle_words, vehicle_role(live(status).vehicle))
    return row(faint(crumb), mode, faint(crumb), vehicle)


def lease_part(station: Station) -> Row:
    """Return the holder of the lease; nothing for a recording."""
    if not station.live:
        return ()
    return row(
        head("lease "), Span(station.lease.words, "caution" if station.lease.others else "text")
    )


def presence(station: Station) -> Span:
    """Return a filled circle while heartbeats arrive, but a triangle while the robot is stopped."""
    seen = station.seen(HEARTBEAT)
    if seen.age is Age.GONE:
        return Span("○", "danger")
    stopped = stop_role(station)
    return Span("▲", stopped) if stopped else Span("●", role_of(seen, OK))


def stop_role(station: Station) -> str:
    """Return the role of a robot that has stopped itself, or is being stopped; else nothing.

    An old status counts, too: a lost robot is still stopped.
    """
    if station.stopping:
        return DANGER
    status = station.seen(STATUS).message
    role = vehicle_role(status.vehicle) if isinstance(status, NavigatorStatus) else OK
    return role if role in (CAUTION, DANGER) else ""


def mode_words(status: NavigatorStatus) -> str:
    """Return the mode as text."""
    return name_of(Mode, status.mode)


def vehicle_words(status: NavigatorStatus) -> str:
    """Return the vehicle's state as text."""
    words = {Vehicle.ACTIVE: "ARMED", Vehicle.STANDBY: "DISARMED", Vehicle.EMERGENCY_STOP: "E-STOP"}
    known = status.vehicle in list(words)
    return words[Vehicle(status.vehicle)] if known else name_of(Vehicle, status.vehicle)


def navigator_words(status: NavigatorStatus) -> str:
    """Return navigator and side as text."""
    name = NAMES.get(status.navigator, f"navigator {status.navigator}")
    return f"{name}/{SIDE_NAMES.get(status.side, 'auto')}"


def link_part(station: Station) -> Row:
    """Return received frames in percent, round-trip time and rate; nothing for a recording.

    All have a fixed width, so that the parts behind them keep their places.
    """
    percent, trip_ms = station.link_percent, station.round_trip_ms
    if not station.live:
        return ()
    role = "text" if percent is not None and percent >= 99.0 else "caution"
    beat = station.seen(HEARTBEAT)
    rate = next((line.rate_hz for line in station.streams() if line.topic is STATUS), None)
    spans = [Span(f" {number(percent, '.0f'):>3}%", role), Span(f" {number(trip_ms, '.0f'):>3}ms")]
    if beat.age is Age.GONE:
        return row(head("link"), faint(f" {MISSING}"))
    return row(head("link"), *spans, Span(f" {number(rate, '.0f'):>2}Hz"))


def kind_part(session: SessionInfo) -> Row:
    """Return simulation, real or replay as a word, not only as a colour."""
    if not session.kind.startswith(SIMULATION):
        return row(Span(session.kind, "caution"))
    hint = f", {session.hint}" if session.hint else ""
    return row(Span(session.kind, "accent"), Span(hint, "caution"))
