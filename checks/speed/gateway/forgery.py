"""Forged, replayed and unsigned commands where signing is required, by what the robot receives."""

import argparse
import secrets
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import count, cycle
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from threading import Event, Lock
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx

from checks.harness.figures import Figure, figure
from checks.harness.mavlink_client import GROUND_STATION, Line, MavlinkClient, stamp_now
from checks.harness.until import until
from checks.speed.gateway.reactions import channels, stick, velocity
from checks.speed.gateway.stage import Air, Figures, on_air, position_target
from gateways.mavlink.mav_service import MAVLINK_1_LAST
from gateways.mavlink.mavlink_dialect import REQUEST_OPERATOR_CONTROL, MavMessage, mavlink
from gateways.mavlink.signing import PER_S
from ground.user.mavlink_keys import KeyRing, new_key, write_keys
from protocol.topics import COMMANDED, GATEWAY, STOP, TELEOP, Topic
from protocol.wire.codec import SIGNATURE_SIZE, decode
from protocol.wire.enums import Mode
from protocol.wire.messages import GatewayStatus

HEADER: Final = 10
STALE_S: Final = 120
FUTURE_S: Final = 600
OWN_KEY: Final = bytes(range(32))
"""The attacker's own key."""
MODES: Final = (Mode.MANUAL, Mode.HOLD, Mode.AUTO, Mode.GUIDED)
FULL_SPEED: Final = 1.0


def command(number: int, *params: float) -> MavMessage:
    """Return a COMMAND_LONG for the robot."""
    values = (*params, *(0.0,) * (7 - len(params)))
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *values)


def commands(place: tuple[int, int]) -> list[MavMessage]:
    """Return messages that would change something if they were obeyed."""
    return [
        command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 21196.0),
        command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0),
        command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0),
        command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0),
        *(command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(mode)) for mode in MODES),
        *(mavlink.MAVLink_set_mode_message(1, 1, int(mode)) for mode in MODES),
        mavlink.MAVLink_command_int_message(
            1, 1, 6, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, -1.0, 1.0, 0.0, 0.0, *place, 0.0
        ),
        command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH),
        command(mavlink.MAV_CMD_MISSION_START),
        command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1.0, 0.3),
        command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0),
        command(mavlink.MAV_CMD_DO_SET_HOME, 0.0, 0.0, 0.0, 0.0, place[0] / 1e7, place[1] / 1e7),
        command(REQUEST_OPERATOR_CONTROL, 1.0, 1.0, 10.0, 0.0),
        position_target(3.0, 2.0),
        velocity(FULL_SPEED),
        stick(FULL_SPEED),
        channels(FULL_SPEED),
        mavlink.MAVLink_param_set_message(1, 1, b"V_MAX_M_S", 0.2, 9),
        mavlink.MAVLink_mission_count_message(1, 1, 2),
        mavlink.MAVLink_mission_clear_all_message(1, 1),
        mavlink.MAVLink_setup_signing_message(1, 1, list(OWN_KEY), 0),
    ]


class Forger:
    """Makes frames. `key` is the owner's, used only with wrong times; `captured` its frames."""

    def __init__(self, key: bytes, captured: Sequence[bytes], place: tuple[int, int]) -> None:
        self._key = key
        self._captured = captured
        self._random = Random(1)
        self._supply = cycle(commands(place))
        self._sequence = count()

    def frames(self, kind: str, number: int) -> Iterator[bytes]:
        """Yield so many frames of a kind."""
        for _ in range(number):
            yield KINDS[kind](self)

    def replayed(self) -> bytes:
        """Return a frame that the owner has sent."""
        return self._random.choice(self._captured)

    def wrong_key(self) -> bytes:
        """Return a frame signed with a key of the attacker."""
        return self._signed(secrets.token_bytes(32), 0)

    def wrong_key_in_future(self) -> bytes:
        """Return the same with a later time, which must not lock the owner out."""
        return self._signed(OWN_KEY, FUTURE_S)

    def stale(self) -> bytes:
        """Return a frame with a valid signature that is two minutes old, perhaps of a new link."""
        return self._signed(self._key, -STALE_S)

    def future(self) -> bytes:
        """Return a frame with a valid signature ten minutes ahead."""
        return self._signed(self._key, FUTURE_S)

    def unsigned(self) -> bytes:
        """Return a frame of MAVLink 2 without a signature."""
        return self._packed(self._encoder())

    def version1(self) -> bytes:
        """Return a frame of MAVLink 1."""
        encoder = self._encoder()
        message = next(one for one in self._supply if one.get_msgId() <= MAVLINK_1_LAST)
        return bytes(message.pack(encoder, force_mavlink1=True))

    def other_system(self) -> bytes:
        """Return an unsigned or wrongly signed frame under any system id, the robot's too."""
        encoder = self._encoder(self._random.randrange(256), self._random.randrange(256))
        if self._random.random() < 0.5:
            sign(encoder, OWN_KEY, stamp_now(), self._random.randrange(256))
        return self._packed(encoder)

    def truncated(self) -> bytes:
        """Return a captured command whose signature is cut."""
        return self.replayed()[: -self._random.randrange(1, SIGNATURE_SIZE + 1)]

    def tampered(self) -> bytes:
        """Return another command under the newest signature of the owner, with a later time."""
        donor, frame = self._captured[-1], bytearray(self._signed(OWN_KEY, 0))
        frame[-SIGNATURE_SIZE:] = donor[-SIGNATURE_SIZE:]
        frame[5:7] = donor[5:7]
        number = int.from_bytes(frame[7:10], "little")
        extra = mavlink.mavlink_map[number].crc_extra
        end = len(frame) - SIGNATURE_SIZE - 2
        frame[end : end + 2] = mcrf4xx(bytes(frame[1:end]) + bytes((extra,))).to_bytes(2, "little")
        late = int.from_bytes(donor[-12:-6], "little") + self._random.randrange(1, PER_S)
        frame[-12:-6] = late.to_bytes(6, "little")
        return bytes(frame)

    def _signed(self, key: bytes, ahead_s: int) -> bytes:
        encoder = self._encoder()
        stamp = stamp_now() + ahead_s * PER_S
        sign(encoder, key, stamp, self._random.choice((0, self._random.randrange(256))))
        return self._packed(encoder)

    def _encoder(self, system: int = GROUND_STATION, component: int = 190) -> Any:
        encoder = mavlink.MAVLink(None, system, component)
        encoder.seq = next(self._sequence) & 0xFF
        return encoder

    def _packed(self, encoder: Any) -> bytes:
        return bytes(next(self._supply).pack(encoder))


def sign(encoder: Any, key: bytes, stamp: int, link: int) -> None:
    """Let an encoder sign its next frame."""
    encoder.signing.secret_key = key
    encoder.signing.sign_outgoing = True
    encoder.signing.timestamp = stamp
    encoder.signing.link_id = link


KINDS: Final[Mapping[str, Callable[[Forger], bytes]]] = {
    "replayed": Forger.replayed,
    "wrong key": Forger.wrong_key,
    "wrong key, future": Forger.wrong_key_in_future,
    "stale": Forger.stale,
    "future": Forger.future,
    "unsigned": Forger.unsigned,
    "MAVLink 1": Forger.version1,
    "other system": Forger.other_system,
    "truncated": Forger.truncated,
    "tampered": Forger.tampered,
}


MIN_FRAMES: Final = 2000
SPACING_S: Final = 0.004
SETTLE_S: Final = 0.3
STATES: Final = (Mode.GUIDED, Mode.MANUAL, Mode.HOLD)
"""The robot stands in each of these in turn, so that each attack could have an effect."""
STILL_M: Final = 0.01


class CommandCounter:
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


class ForgeryTrial:
    """Attacks and the owner's own commands in turn."""

    def __init__(self, air: Air, owner: MavlinkClient, key: bytes) -> None:
        self._owner, self._air = owner, air
        self._witness = CommandCounter(air)
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
            MavlinkClient(air.line(), key=raw) as owner,
        ):
            owner.await_vehicle()
            until(lambda: "GLOBAL_POSITION_INT" in owner.newest, "a position")
            before = air.observer.truths[-1][0]
            trial = ForgeryTrial(air, owner, raw)
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


def figures_of(trial: ForgeryTrial, refused: int, moved_m: float, *, is_same: bool) -> list[Figure]:
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
        figure(
            f"commands of the owner obeyed, of {trial.owned}", trial.obeyed, at_least=trial.owned
        ),
        figure("the key is still the owner's", is_same, at_least=1.0),
        figure("way of the robot", moved_m, "m", at_most=STILL_M),
    ]
    return found
