"""Forged, replayed and unsigned commands where signing is required, by what the robot receives."""

import argparse
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Lock
from typing import Any, Final

from checks.harness.figures import Figure
from checks.harness.until import until
from checks.speed.gateway.client import Client, Line
from checks.speed.gateway.forged_frames import KINDS, Forger
from checks.speed.gateway.stage import Air, Figures, on_air
from ground.user.mavlink_keys import KeyRing, new_key, write_keys
from protocol.topics import COMMANDED, GATEWAY, STOP, TELEOP, Topic
from protocol.wire.codec import decode
from protocol.wire.enums import Mode
from protocol.wire.messages import GatewayStatus

MIN_FRAMES: Final = 2000
SPACING_S: Final = 0.004
SETTLE_S: Final = 0.3
STATES: Final = (Mode.GUIDED, Mode.MANUAL, Mode.HOLD)
"""The robot stands in each of these in turn, so that each attack could have an effect."""
STILL_M: Final = 0.01


class Witness:
    """Counts the requests, manual speeds and stops that reach the robot over its bus."""

    def __init__(self, air: Air) -> None:
        self._lock = Lock()
        self._seen: Counter[str] = Counter()
        self.refused = 0
        for topic in (COMMANDED, TELEOP, STOP):
            self._count(air, topic)
        air.observer.bus.stream(GATEWAY, self._note, air.observer.robot)

    def take(self) -> Counter[str]:
        """Return the messages counted since the last call."""
        with self._lock:
            taken, self._seen = self._seen, Counter()
        return taken

    def _count(self, air: Air, topic: Topic[Any]) -> None:
        def note(_key: str, frame: bytes, _arrived_ns: int) -> None:
            with self._lock:
                self._seen[type(decode(frame).message).__name__] += 1

        air.observer.bus.stream(topic, note, air.observer.robot)

    def _note(self, _key: str, frame: bytes, _arrived_ns: int) -> None:
        message = decode(frame).message
        if isinstance(message, GatewayStatus):
            self.refused = message.refused


class Trial:
    """Attacks and the owner's own commands in turn."""

    def __init__(self, air: Air, owner: Client, key: bytes) -> None:
        self._owner, self._air = owner, air
        self._witness = Witness(air)
        self._pause = Event()
        self._stranger: Line = air.line()
        captured = owner.sent = []
        owner.set_mode(Mode.GUIDED)
        owner.arm()
        for mode in STATES:
            owner.set_mode(mode)
        place = owner.newest["GLOBAL_POSITION_INT"]
        self._forger = Forger(key, tuple(captured), (place.lat + 100, place.lon + 100))
        owner.sent = None
        self.sent: Counter[str] = Counter()
        self.acted: Counter[str] = Counter()
        self.obeyed = self.owned = 0

    def round(self, state: Mode, frames: int) -> None:
        """Let the owner choose a state; attack in it, from a stranger's and the owner's port."""
        self._command(state)
        for kind in KINDS:
            self._attack(kind, self._stranger, frames - frames // 4)
            self._attack(kind, self._owner.line, frames // 4)

    def close(self) -> int:
        """Return how many frames the gateway has refused for their signature."""
        self._pause.wait(1.5)
        self._stranger.close()
        return self._witness.refused

    def _command(self, state: Mode) -> None:
        """Command as the owner; count whether the robot has received it."""
        self._witness.take()
        self.owned += 1
        self._owner.set_mode(state)
        until(lambda: self._air.observer.status.mode == state, f"mode {state.name}")
        self._pause.wait(SETTLE_S)
        self.obeyed += bool(self._witness.take())

    def _attack(self, kind: str, line: Line, frames: int) -> None:
        for frame in self._forger.frames(kind, frames):
            line.send(frame)
            self._pause.wait(SPACING_S)
        self._pause.wait(SETTLE_S)
        self.sent[kind] += frames
        self.acted[kind] += sum(self._witness.take().values())


def forgery_figures(options: argparse.Namespace) -> Figures:
    """Attack a gateway that requires signing."""
    ring = KeyRing(key=(new_key(),))
    raw = ring.key[0].raw
    with TemporaryDirectory(prefix="sidestep-keys-") as folder:
        path = Path(folder) / "keys.toml"
        write_keys(path, ring)
        required = ("udpin:127.0.0.1:{port},require",)
        with (
            on_air("--signing-keys", str(path), endpoints=required) as air,
            Client(air.line(), key=raw) as owner,
        ):
            owner.await_vehicle()
            until(lambda: "GLOBAL_POSITION_INT" in owner.newest, "a position")
            before = air.observer.truths[-1][0]
            trial = Trial(air, owner, raw)
            for number in range(options.rounds):
                trial.round(STATES[number % len(STATES)], options.forged)
            refused = trial.close()
            after, keys = air.observer.truths[-1][0], path.read_text(encoding="utf-8")
            moved_m = abs(after.x_m - before.x_m) + abs(after.y_m - before.y_m)
    return figures_of(trial, refused, moved_m, is_same=ring.key[0].secret in keys), [
        "forgery: " + ", ".join(f"{kind} {number}" for kind, number in trial.sent.items()),
        "acted on: samples on the robot's bus of requests (its own copies, refused ones too),"
        f" manual speeds and stops; the signing owner is in each of {names(STATES)} in turn;"
        " a quarter of the frames comes from the owner's own port",
    ]


def names(modes: Iterable[Mode]) -> str:
    """Return the names of modes."""
    return ", ".join(mode.name for mode in modes)


def figures_of(trial: Trial, refused: int, moved_m: float, *, is_same: bool) -> list[Figure]:
    """Return the numbers of frames sent and of commands carried out."""
    sent = sum(trial.sent.values())
    found = [
        figure("forged, replayed and unsigned commands", sent, at_least=MIN_FRAMES),
        figure("of these acted on", sum(trial.acted.values()), at_most=0.0),
    ]
    found += [
        figure(f"acted on, {kind}, of {number}", trial.acted[kind], at_most=0.0)
        for kind, number in trial.sent.items()
    ]
    found += [
        figure("refused for their signature, by the gateway's count", refused, at_least=sent / 2),
        figure(f"commands of the owner obeyed, of {trial.owned}", trial.obeyed, trial.owned),
        figure("the key is still the owner's", is_same, at_least=1.0),
        Figure(name="way of the robot", unit="m", values=(moved_m,), at_most=STILL_M),
    ]
    return found


def figure(
    name: str, value: float, at_least: float | None = None, at_most: float | None = None
) -> Figure:
    """Return a figure with a single value."""
    return Figure(name=name, unit="", values=(float(value),), at_least=at_least, at_most=at_most)
