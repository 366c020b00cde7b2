"""Signatures of MAVLink 2: time stamps, verification, and the rights of a client by each frame.

Stamps count units of 10 us since 2015, and none is used twice, also after a restart. Those from
before the start of the process are refused, so that nothing recorded before a restart can be
replayed. A file keeps the newest stamp: the clock may be set back, or the clock of a client may be
ahead.

Frames are verified before any protocol sees them. The signature is checked first: a forged frame
changes nothing here. pymavlink stores the time stamp of a frame before it checks the signature. One
forged stamp from the future then locks the owner out, so its check is not used.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from hashlib import sha256
from hmac import compare_digest
from pathlib import Path
from threading import Thread
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from gateways.mavlink.framing import MavFrame
from gateways.mavlink.mavlink_dialect import mavlink
from ground.user.mavlink_keys import KeyRing, SigningKey
from runtime.files import make_folder, replace, text_in
from runtime.units import NS_PER_S

EPOCH_S: Final = 1_420_070_400
"""2015-01-01 00:00 UTC as Unix time."""
STAMP_NS: Final = 10_000
PER_S: Final = 100_000
MAX_BYTES: Final = 4096
SAVED_EVERY: Final = 10 * PER_S
"""Interval at which the file is written."""
MAX_STAMP: Final = (1 << 47) - 1
"""The year 2059: half of what the field can carry, so that later stamps fit too.

A file with a larger number is damaged.
"""
MAX_DIGITS: Final = len(str(MAX_STAMP))


class StampClock:
    """Issues stamps, and stores the newest one that was used; `floor` is the stamp of the start."""

    def __init__(
        self,
        unix_ns: Callable[[], int],
        path: Path | None = None,
        write: Callable[[Path, int], None] | None = None,
    ) -> None:
        self._unix_ns = unix_ns
        self._path = path
        self._write = write or write_stamp
        self._saved = _read(path)
        self.floor = self._newest = max(self._saved, self.now())

    @property
    def newest(self) -> int:
        """The present, as clients have to see it: the newest stamp, also if the clock is behind."""
        return max(self._newest, self.now())

    def now(self) -> int:
        """Return the stamp of the present time."""
        return max(0, self._unix_ns() - EPOCH_S * NS_PER_S) // STAMP_NS

    def next(self) -> int:
        """Return a stamp for a frame to send: the present time, and later than all before."""
        self._newest = max(self._newest + 1, self.now())
        if self._newest >= self._saved + SAVED_EVERY:
            self._save(self._newest)
        return self._newest

    def accept(self, stamp: int) -> None:
        """Store the stamp of a verified frame."""
        self._newest = max(self._newest, stamp)
        if self._newest >= self._saved + SAVED_EVERY:
            self._save(self._newest)
        elif stamp > self.now() and stamp > self._saved:
            self._save(stamp + SAVED_EVERY)

    def _save(self, stamp: int) -> None:
        self._saved = stamp
        if self._path is not None:
            self._write(self._path, stamp)


class BackgroundWriter:
    """Writes stamps in another thread, so that a slow disk delays no frame; may leave some out."""

    def __init__(self) -> None:
        self._thread: Thread | None = None

    def __call__(self, path: Path, stamp: int) -> None:
        """Begin to write a stamp unless the one before is still being written."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = Thread(target=write_stamp, args=(path, stamp), daemon=True)
            self._thread.start()


def write_stamp(path: Path, stamp: int) -> None:
    """Replace the stamp in the file, if that is possible."""
    with suppress(OSError):
        make_folder(path.parent)
        replace(path, f"{stamp}\n")


def _read(path: Path | None) -> int:
    try:
        text = "" if path is None else text_in(path, MAX_BYTES).strip()
    except (OSError, ValueError):
        return 0
    is_number = text.isascii() and text.isdecimal() and len(text) <= MAX_DIGITS
    stamp = int(text) if is_number else 0
    return stamp if stamp <= MAX_STAMP else 0


MINUTE: Final = 60 * PER_S
"""Largest difference of a stamp to the present: before it for a new stream, after it for any.

Clients set their stamps forward to those that they receive.
"""
MAX_STREAMS: Final = 256
LINK_AT: Final = -13
STAMP: Final = slice(-12, -6)
SIGNATURE_SLICE: Final = slice(-6, None)


class SignatureVerdict(Enum):
    """The result of the check of a frame."""

    UNSIGNED = "unsigned"
    VALID = "valid"
    FORGED = "forged"
    REPLAYED = "replayed"
    FUTURE = "future"


class AcceptedStamp(NamedTuple):
    """The newest stamp of a stream, and the time of its arrival as a stamp."""

    stamp: int
    at: int


class Verifier:
    """The keys, and the newest stamp of each stream: link id, system and component.

    `keys` are the valid ones. Without keys every frame counts as unsigned.
    """

    def __init__(self, clock: StampClock, keys: tuple[bytes, ...] = ()) -> None:
        self.keys = keys
        self._clock = clock
        self._streams: dict[tuple[int, int, int], AcceptedStamp] = {}

    def check(self, frame: MavFrame) -> SignatureVerdict:
        """Return the verdict on a frame; only a valid one changes the state."""
        if not (frame.is_signed and self.keys):
            return SignatureVerdict.UNSIGNED
        if not any(_is_signed_by(key, frame.data) for key in self.keys):
            return SignatureVerdict.FORGED
        stamp = int.from_bytes(frame.data[STAMP], "little")
        stream = (frame.data[LINK_AT], frame.system, frame.component)
        if stamp > self._clock.newest + MINUTE:
            return SignatureVerdict.FUTURE
        known = self._streams.get(stream)
        if stamp <= self._oldest(known) or (known is None and len(self._streams) >= MAX_STREAMS):
            return SignatureVerdict.REPLAYED
        self._streams[stream] = AcceptedStamp(stamp, self._clock.now())
        self._clock.accept(stamp)
        return SignatureVerdict.VALID

    def _oldest(self, known: AcceptedStamp | None) -> int:
        """Return the stamp that the next one of a stream must exceed.

        A stream that was silent must have advanced meanwhile. Otherwise frames that were
        recorded on their way, and never arrived, could be sent much later.
        """
        now = self._clock.now()
        if known is None:
            return max(now - MINUTE, self._clock.floor)
        return max(known.stamp, known.stamp + now - known.at - MINUTE)


def _is_signed_by(key: bytes, data: bytes) -> bool:
    signature = sha256(key + data[:-6]).digest()[:6]
    return compare_digest(signature, data[SIGNATURE_SLICE])


class Policy(Enum):
    """The unsigned frames of an endpoint that may command."""

    REQUIRE = "require"
    """None of them."""
    LOOPBACK = "loopback"
    """Those from this machine."""
    ACCEPT = "accept"
    """All of them; refused for a TCP port that other machines reach."""
    ANYONE = "anyone"
    """All of them, also there."""


class Rights(Enum):
    """The rights of a frame."""

    NONE = 0
    STOP = 1
    """Nothing but an emergency stop."""
    WATCH = 2
    COMMAND = 3


WATCHING: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_PING,
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_ACK,
        mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
        mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST,
        mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM,
        mavlink.MAVLINK_MSG_ID_SET_MODE,
        mavlink.MAVLINK_MSG_ID_COMMAND_INT,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
        mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END,
        mavlink.MAVLINK_MSG_ID_SETUP_SIGNING,
    }
)
"""Messages that a client without the right to command may send. The protocols of commands, missions
and signing reject everything but reading; files are read-only."""

DOUBTS: Final = MappingProxyType(
    {
        SignatureVerdict.FUTURE: "is ahead of the gateway's clock",
        SignatureVerdict.REPLAYED: "is old, or was used before: a wrong clock, or a replay",
    }
)
"""What is wrong with the time stamp of a frame that is signed with a valid key. Such a frame can
only stop: a stop for nothing costs little, and one that is missing may cost a robot."""


@dataclass(slots=True)
class Counters:
    """Frames of one client, counted by the verdict on them."""

    signed: int = 0
    unsigned: int = 0
    forged: int = 0
    replayed: int = 0
    future: int = 0

    @property
    def refused(self) -> int:
        """Frames that command nothing because of their signature or its time stamp."""
        return self.forged + self.replayed + self.future


def rights_of(verdict: SignatureVerdict, policy: Policy, *, is_loopback: bool) -> Rights:
    """Return the rights of a frame."""
    if verdict is SignatureVerdict.VALID:
        return Rights.COMMAND
    if verdict in DOUBTS:
        return Rights.STOP
    if verdict is not SignatureVerdict.UNSIGNED:
        return Rights.NONE
    if policy in (Policy.ACCEPT, Policy.ANYONE) or (policy is Policy.LOOPBACK and is_loopback):
        return Rights.COMMAND
    return Rights.WATCH


def count(counters: Counters, verdict: SignatureVerdict) -> None:
    """Count a verdict."""
    match verdict:
        case SignatureVerdict.VALID:
            counters.signed += 1
        case SignatureVerdict.UNSIGNED:
            counters.unsigned += 1
        case SignatureVerdict.FORGED:
            counters.forged += 1
        case SignatureVerdict.REPLAYED:
            counters.replayed += 1
        case SignatureVerdict.FUTURE:
            counters.future += 1


Save = Callable[[KeyRing], None]


class SigningGuard:
    """Used by all clients and vehicles of a gateway.

    `policies` are those of the endpoints by their text, LOOPBACK by default. `save` keeps keys that
    a client has set.
    """

    def __init__(
        self,
        unix_ns: Callable[[], int],
        ring: KeyRing | None = None,
        policies: Mapping[str, Policy] | None = None,
        *,
        save: Save = lambda _: None,
        stamps: Path | None = None,
        write_stamp: Callable[[Path, int], None] | None = None,
    ) -> None:
        self._policies = dict(policies or {})
        self._clock = StampClock(unix_ns, stamps, write_stamp)
        self._verifier = Verifier(self._clock)
        self._save = save
        self._armed: list[Callable[[], bool]] = []
        self._use(ring or KeyRing())

    @property
    def is_signing(self) -> bool:
        """True if there is a key, so that all frames are signed."""
        return self._current is not None

    @property
    def is_required(self) -> bool:
        """True if an endpoint takes commands only from clients that sign."""
        return Policy.REQUIRE in self._policies.values()

    @property
    def is_any_armed(self) -> bool:
        """True if a robot of the gateway is armed; all of them have the same key."""
        return any(is_armed() for is_armed in self._armed)

    def watch(self, is_armed: Callable[[], bool]) -> None:
        """Add a robot."""
        self._armed.append(is_armed)

    def check(
        self, frame: MavFrame, counters: Counters, endpoint: str, *, is_loopback: bool
    ) -> tuple[Rights, SignatureVerdict]:
        """Count a received frame; return its rights, and the verdict on its signature."""
        verdict = self._verifier.check(frame)
        count(counters, verdict)
        policy = self._policies.get(endpoint, Policy.LOOPBACK)
        return rights_of(verdict, policy, is_loopback=is_loopback), verdict

    def prepare(self, encoder: Any) -> None:
        """Set up pymavlink to sign the next frame of an encoder, if there is a key."""
        signing = encoder.signing
        signing.sign_outgoing = self._current is not None
        if self._current is not None:
            signing.secret_key = self._current
            signing.timestamp = self._clock.next()

    def replace_key(self, secret: bytes | None) -> None:
        """Replace all keys by this one, or by none; OSError and UserError if it cannot be saved."""
        ring = KeyRing(key=() if secret is None else (SigningKey(secret=secret.hex()),))
        self._save(ring)
        self._use(ring)

    def is_current(self, secret: bytes) -> bool:
        """Return whether this key signs."""
        return self._current == secret

    def _use(self, ring: KeyRing) -> None:
        keys = tuple(key.raw for key in ring.key)
        self._current = keys[0] if keys else None
        self._verifier.keys = keys
