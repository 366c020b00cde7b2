"""Call the operator: ring the terminal's bell and show a message, once for each event."""

from typing import TYPE_CHECKING, Final, Literal

from ground.app.stops.stop_watch import EventKind, StopEvent, StopWatch

if TYPE_CHECKING:
    from ground.app.app import GroundApp

Severity = Literal["information", "warning", "error"]
SEVERITIES: Final[dict[EventKind, Severity]] = {
    EventKind.EMERGENCY_STOP: "error",
    EventKind.FAILSAFE: "warning",
    EventKind.REACHED: "information",
}
SHOWN_S: Final = 6.0
MIN_COLUMNS: Final = 60
MIN_ROWS: Final = 18
"""A smaller screen shows no message, which would hide its content: the band and the log remain."""


class Alerts:
    """Watches the station of the app; `quiet` keeps the bell silent."""

    def __init__(self, app: "GroundApp", *, quiet: bool) -> None:
        self.watch = StopWatch()
        self._app = app
        self._quiet = quiet

    def poll(self) -> None:
        """Announce what has happened since the last poll; of a recording, nothing."""
        station = self._app.station
        events = self.watch.look(station)
        if not events or not station.live:
            return
        if not self._quiet:
            self._app.bell()
        width, height = self._app.size
        if width >= MIN_COLUMNS and height >= MIN_ROWS:
            for event in events:
                self._show(event)

    def _show(self, event: StopEvent) -> None:
        words = f"{event.robot} {event.kind.value}"
        text = f"{words}: {event.cause}" if event.cause else words
        self._app.notify(text, severity=SEVERITIES[event.kind], timeout=SHOWN_S, markup=False)
