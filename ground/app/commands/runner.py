"""Command lines of the app: the same words and the same code as the shell's, off the UI thread."""

import argparse
import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from io import StringIO
from types import MappingProxyType
from typing import Final

from ground.cli.command.teleop import Stick
from ground.client.connection import Common
from ground.client.link import Link
from ground.console import History, Word, act, act_locally, complete, parse
from ground.console.aliases import unfolded
from ground.console.tokenizer import words_of
from ground.map import Target
from ground.missions.draft import Draft
from ground.station import Outcome, Station
from ground.station.robot.mission_items import target_of
from ground.text.output import Says
from protocol.bus.bus import Bus
from protocol.options import DEFAULT_ENDPOINT
from protocol.wire.enums import Severity
from runtime.clock import Clock
from runtime.errors import UserError

STILL: Final = frozenset(
    ("hold", "abort", "disarm", "doctor", "watch", "export", "explain", "plot", "trial")
)
"""Verbs that move nothing, and need neither the lease nor a robot that is ready."""
LOOKS: Final = frozenset(
    ("list", "get", "diff", "show", "save", "status", "download", "check", "convert")
)
"""Actions of other verbs of which the same is true."""

LEASES: Final[Mapping[str, Callable[[Station], None]]] = MappingProxyType(
    {
        "take": Station.take_lease,
        "seize": lambda station: station.take_lease(seize=True),
        "release": Station.release_lease,
    }
)
"""Who holds the lease must beat for it: that is the station's."""

REPLAYED: Final = "this is a replay: nothing can be commanded"


class Orders:
    """`local`: the words that the app does itself; they are done at once."""

    def __init__(
        self,
        station: Callable[[], Station],
        bus: Bus | None,
        common: Common,
        clock: Clock,
        history: History,
    ) -> None:
        """`station` is asked each time; without a `bus` there is no robot to be commanded."""
        self._station_now = station
        self._bus, self._common, self._clock = bus, common, clock
        self._history = history
        self._stick: Stick | None = None
        self.local: Mapping[str, Word] = {}
        self.draft = Draft()
        self.last = ""

    @property
    def _station(self) -> Station:
        return self._station_now()

    def give(self, line: str) -> None:
        if not line:
            return
        self._history.add(line)
        try:
            options = parse(line)
        except UserError as error:
            self._station.note(f"{line[:40]}: {error}", Severity.WARNING)
            return
        self.last = self._for_a_shell(line)
        if options.verb == "estop":
            self._station.estop()
        elif options.verb == "lease" and options.action in LEASES:
            LEASES[options.action](self._station)
        elif options.local:
            self._locally(options)
        else:
            self._station.submit(line, lambda: self._done(options), moves=moves(options))

    def is_local(self, line: str) -> bool:
        try:
            return bool(parse(line).local)
        except UserError:
            return True  # it is only said to be wrong

    @property
    def drafted(self) -> tuple[Target, ...]:
        return tuple(map(target_of, self.draft.mission.waypoints))

    def complete(self, text: str) -> list[str]:
        names = [str(line["name"]) for line in self._station.parameters or ()]
        return complete(text, names)

    def recall(self, text: str, step: int) -> str:
        return self._history.previous(text) if step < 0 else self._history.next(text)

    # By hand.

    def take_hand(self) -> bool:
        """MANUAL first; only what the robot then hears moves it."""
        if self._bus is None:
            self._station.note(REPLAYED, Severity.WARNING)
            return False
        options = parse("mode manual")
        stick = Stick(self._link())

        def begin() -> Outcome:
            outcome = self._done(options)
            if outcome.ok:
                stick.stop()
            return outcome

        begun = self._station.submit("mode manual", begin)
        self._stick = stick if begun else None
        return begun

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        if self._stick is not None:
            self._stick.drive(speed_m_s, yaw_rate_rad_s)

    def drop_hand(self) -> None:
        self.steer(0.0, 0.0)
        self._stick = None
        self.give("mode hold")

    def _done(self, options: argparse.Namespace) -> Outcome:
        """In a thread of its own, over a link of its own: request ids are never shared."""
        says, out, err = heard()
        code = act(options, self._link(), says, draft=self.draft)
        return Outcome(code == 0, told(out, err))

    def _locally(self, options: argparse.Namespace) -> None:
        says, out, err = heard()
        code = act_locally(options, says, {"wp": self.draft.act, **self.local})
        for text in told(out, err).splitlines():
            self._station.note(text, Severity.WARNING if code else Severity.INFO)

    def _link(self) -> Link:
        """To the robot that is shown now."""
        if self._bus is None:
            raise UserError(REPLAYED)
        common = replace(self._common, robot=self._station.robot)
        return Link(self._bus, common, self._clock)

    def _for_a_shell(self, line: str) -> str:
        words = ["sidestep", *unfolded(words_of(line))]
        if self._station.robot != "r1":
            words += ["--id", self._station.robot]
        if self._common.endpoint != DEFAULT_ENDPOINT:
            words += ["--connect", self._common.endpoint]
        return shlex.join(words)


def moves(options: argparse.Namespace) -> bool:
    """Whether a command can move the robot, or change how it moves."""
    return options.verb not in STILL and getattr(options, "action", "") not in LOOKS


def heard() -> tuple[Says, StringIO, StringIO]:
    """Something to speak into that is no terminal."""
    out, err = StringIO(), StringIO()
    return Says(as_json=False, out=out, err=err), out, err


def told(out: StringIO, err: StringIO) -> str:
    """The result, or what was said instead of one."""
    return (out.getvalue() or err.getvalue()).strip()
