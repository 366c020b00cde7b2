"""Frames of an attacker: commands with a wrong, an old or no signature."""

import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count, cycle
from random import Random
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx

from checks.speed.gateway.client import GROUND_STATION, PER_S, stamp_now
from checks.speed.gateway.stage import position_target
from checks.speed.gateway.timeouts import channels, stick, velocity
from gateways.mavlink.mavlink_dialect import REQUEST_OPERATOR_CONTROL, MavMessage, mavlink
from protocol.wire.enums import Mode

MAVLINK_1_IDS: Final = 256
SIGNATURE: Final = 13
HEADER: Final = 10
STALE_S: Final = 120
FUTURE_S: Final = 600
OWN_KEY: Final = bytes(range(32))
"""The attacker's own key."""
MODES: Final = (Mode.MANUAL, Mode.HOLD, Mode.AUTO, Mode.GUIDED)
FULL_SPEED: Final = 1.0


class NoFile:
    """The output of an encoder that never sends."""

    def write(self, data: bytes) -> None:
        """Ignore the bytes."""


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
        message = next(one for one in self._supply if one.get_msgId() < MAVLINK_1_IDS)
        return bytes(message.pack(encoder, force_mavlink1=True))

    def other_system(self) -> bytes:
        """Return an unsigned or wrongly signed frame under any system id, the robot's too."""
        encoder = self._encoder(self._random.randrange(256), self._random.randrange(256))
        if self._random.random() < 0.5:
            sign(encoder, OWN_KEY, stamp_now(), self._random.randrange(256))
        return self._packed(encoder)

    def truncated(self) -> bytes:
        """Return a captured command whose signature is cut."""
        return self.replayed()[: -self._random.randrange(1, SIGNATURE + 1)]

    def tampered(self) -> bytes:
        """Return another command under the newest signature of the owner, with a later time."""
        donor, frame = self._captured[-1], bytearray(self._signed(OWN_KEY, 0))
        frame[-SIGNATURE:] = donor[-SIGNATURE:]
        frame[5:7] = donor[5:7]
        number = int.from_bytes(frame[7:10], "little")
        extra = mavlink.mavlink_map[number].crc_extra
        end = len(frame) - SIGNATURE - 2
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
        encoder = mavlink.MAVLink(NoFile(), system, component)
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
