"""Teleop from keys: MANUAL is asked for, keys are held and let go; who takes it away wins."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

from ground.app.input.dead_man import WAYS, DeadMan
from ground.app.panels.aged import live
from ground.app.playback.app_interface import Deck
from protocol.topics import STATUS
from protocol.wire.enums import Mode

SETTLE_NS: Final = 1_500_000_000
"""So long the robot may take to be in MANUAL."""


class ByHand:
    """`held` while keys drive."""

    def __init__(self, deck: Deck) -> None:
        self._deck = deck
        self._keys = DeadMan()
        self._since_ns = 0
        self.held = False

    def actions(self) -> Mapping[str, Callable[[], None]]:
        return {
            f"teleop-{way}{end}": partial(self.push, way, slow=slow)
            for way in WAYS
            for end, slow in (("", False), ("-slow", True))
        }

    def take(self) -> bool:
        """False, with the reason in the log, when it may not be."""
        self.held = self._deck.take_hand()
        self._keys, self._since_ns = DeadMan(), self._deck.station.now_ns
        return self.held

    def push(self, way: str, *, slow: bool) -> None:
        if self.held:
            self._keys.press(way, self._deck.station.now_ns, slow=slow)

    def poll(self) -> bool:
        """Steer for a moment; False when that is over."""
        if self._taken_away():
            self.drop()
        if self.held:
            self._deck.steer(*self._keys.twist(self._deck.station.now_ns))
        return self.held

    def drop(self) -> None:
        self.held = False
        self._deck.drop_hand()

    def _taken_away(self) -> bool:
        """The robot does something else: stopped, disarmed, or commanded by somebody else."""
        station = self._deck.station
        status = live(station.seen(STATUS))
        settled = station.now_ns - self._since_ns > SETTLE_NS
        return settled and (status is None or status.mode != Mode.MANUAL)
