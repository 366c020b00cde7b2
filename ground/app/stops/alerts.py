"""Call the operator, once for each event: the bell, a message, the desktop, and a command."""

import os
import subprocess
from collections.abc import Collection, Sequence
from functools import partial
from typing import Final, NamedTuple

from ground.app.app_interface import AppControl, Loudness
from ground.app.appearance import Appearance
from ground.app.stops.stop_watch import EventKind, StopEvent, StopWatch
from ground.text.wording import few
from runtime.units import NS_PER_S

SEVERITIES: Final[dict[EventKind, Loudness]] = {
    EventKind.EMERGENCY_STOP: "error",
    EventKind.FAILSAFE: "warning",
    EventKind.REACHED: "information",
}
SHOWN_S: Final = 6.0
MIN_COLUMNS: Final = 60
MIN_ROWS: Final = 18
"""A smaller screen shows no message, which would hide its content: the band and the log remain."""


class Alert(NamedTuple):
    """Robots with the same event; `shown_ns` is the time of the last one."""

    robots: tuple[str, ...]
    shown_ns: int


class Alerts:
    """Watches the station of the app, and calls as the appearance says.

    Robots with the same event share a message and a ring, as after a stop of all.
    """

    def __init__(self, app: AppControl, appearance: Appearance) -> None:
        self.watch = StopWatch()
        self._app = app
        self._appearance = appearance
        self._alerts: dict[tuple[EventKind, str], Alert] = {}

    def poll(self) -> None:
        """Announce events since the last poll; none of a recording.

        A message about a stop disappears with the stop.
        """
        station = self._app.station
        events = self.watch.look(station)
        if not (events or self._alerts) or not station.live:
            return
        self._forget(station.now_ns)
        is_over = self._drop_cleared()
        if not events and not is_over:
            return
        known = set(self._alerts)
        for event in events:
            of = event.kind, event.cause
            robots = self._alerts[of].robots if of in self._alerts else ()
            others = tuple(robot for robot in robots if robot != event.robot)
            self._alerts[of] = Alert((*others, event.robot), station.now_ns)
        changed = {(event.kind, event.cause) for event in events}
        self._call(events)
        if not self._appearance.quiet_bell and any(self._is_new(event, known) for event in events):
            self._app.bell()
        width, height = self._app.size
        if width >= MIN_COLUMNS and height >= MIN_ROWS:
            self._show(known, changed, anew=is_over)

    def _call(self, events: Collection[StopEvent]) -> None:
        """Notify the desktop and run the hook, once for all robots with the same event."""
        calls: dict[tuple[EventKind, str], list[str]] = {}
        for event in events:
            calls.setdefault((event.kind, event.cause), []).append(event.robot)
        for (kind, cause), robots in calls.items():
            if self._appearance.desktop:
                self._app.notify_desktop(event_words(robots, kind, cause))
            if self._appearance.hook:
                run = partial(run_hook, self._appearance.hook, robots, kind, cause)
                self._app.run_in_background(run, self._report)

    def _report(self, words: str) -> None:
        if words:
            self._app.note(words)

    def _is_new(self, event: StopEvent, known: Collection[tuple[EventKind, str]]) -> bool:
        """Return whether an event rings: not one that many robots have, as the first has rung."""
        return event.kind is not EventKind.EMERGENCY_STOP or (event.kind, event.cause) not in known

    def _forget(self, now_ns: int) -> None:
        """Forget alerts whose message has disappeared."""
        shown_ns = round(SHOWN_S * NS_PER_S)
        young = {of: one for of, one in self._alerts.items() if now_ns - one.shown_ns < shown_ns}
        self._alerts = young

    def _drop_cleared(self) -> bool:
        """Remove robots whose stop has ended; return whether a message named one of them."""
        before, self._alerts = self._alerts, {}
        is_over = False
        for (kind, cause), one in before.items():
            robots = tuple(
                robot
                for robot in one.robots
                if kind is EventKind.REACHED or self.watch.is_stopped(robot, kind)
            )
            if robots:
                self._alerts[kind, cause] = one._replace(robots=robots)
            is_over |= robots != one.robots and not self._is_in_the_band(kind, one)
        return is_over

    def _is_in_the_band(self, kind: EventKind, one: Alert) -> bool:
        """Return whether the band across the screen shows the same alarm."""
        return kind is not EventKind.REACHED and one.robots == (self._app.station.robot,)

    def _show(
        self,
        known: Collection[tuple[EventKind, str]],
        changed: Collection[tuple[EventKind, str]],
        *,
        anew: bool,
    ) -> None:
        """Show new messages; with `anew`, or if a message names one more robot, show all."""
        shown = changed
        if anew or any(of in known for of in changed):
            self._app.clear_notifications()
            shown = self._alerts.keys()
        for kind, cause in shown:
            one = self._alerts[kind, cause]
            if self._is_in_the_band(kind, one):
                continue
            text = event_words(one.robots, kind, cause)
            left_s = SHOWN_S - (self._app.station.now_ns - one.shown_ns) / NS_PER_S
            self._app.notify(text, severity=SEVERITIES[kind], timeout=left_s, markup=False)


def event_words(robots: Sequence[str], kind: EventKind, cause: str) -> str:
    """Return which robots have stopped or arrived, and why."""
    words = f"{few(robots)} {kind.value}"
    return f"{words}: {cause}" if cause else words


def run_hook(command: str, robots: Sequence[str], kind: EventKind, cause: str) -> str:
    """Run the user's command to its end; return how it failed, empty if it did not."""
    facts = {
        "SIDESTEP_EVENT": kind.name.lower(),
        "SIDESTEP_ROBOTS": " ".join(robots),
        "SIDESTEP_TEXT": event_words(robots, kind, cause),
    }
    done = subprocess.run(
        ("/bin/sh", "-c", command),
        env={**os.environ, **facts},
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        check=False,
    )
    return f"hook: ended with {done.returncode}: {command}" if done.returncode else ""
