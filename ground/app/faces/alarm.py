"""The line under the status: what is lost, or an e-stop that is not acknowledged; else nothing."""

from ground.station.station import Station
from ground.widgets.rows import Row, Span, row


def alarm_rows(station: Station) -> list[Row]:
    """The e-stop first; nothing when there is nothing to say."""
    if station.stopping:
        return [row(Span(f" E-STOP {station.stopping} ", "alarm"))]
    loss = station.loss()
    if loss is not None:
        words = loss.banner(station.now_ns)
        last = f"; last command: {station.last_command}" if station.last_command else ""
        return [row(Span(f" {words}{last} ", "alarm"))]
    if station.live and not station.ready:
        return [row(Span(f" reading {station.waiting_for} before commands are taken ", "caution"))]
    return []
