"""Rows 51 and 54: forged, replayed and future frames are refused, and do not lock the owner out."""

from itertools import count
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from gateways.mavlink import signing
from gateways.mavlink.clients import NoFile
from gateways.mavlink.framing import Deframer, MavFrame
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.signing import (
    EPOCH_S,
    PER_S,
    Counters,
    Policy,
    Rights,
    SignatureVerdict,
    SigningGuard,
    StampClock,
    Verifier,
)
from ground.user.mavlink_keys import KeyRing, SigningKey
from runtime.units import NS_PER_S
from tests.support.until import PATIENCE_S, until

KEY, OLD, WRONG = b"k" * 32, b"o" * 32, b"w" * 32
NOW_S = EPOCH_S + 350_000_000
NOW = (NOW_S - EPOCH_S) * PER_S


class Wall:
    def __init__(self) -> None:
        self.s = float(NOW_S)

    def __call__(self) -> int:
        return round(self.s * NS_PER_S)


def framed(data: bytes) -> MavFrame:
    deframer = Deframer()
    deframer.feed(data)
    deframer.allowance = 10
    (frame,) = deframer.take(0)
    return frame


def signed(
    stamp: int, key: bytes = KEY, *, link: int = 0, system: int = 255, message: Any = None
) -> MavFrame:
    encoder = mavlink.MAVLink(NoFile(), system, 190)
    encoder.signing.secret_key, encoder.signing.sign_outgoing = key, True
    encoder.signing.timestamp, encoder.signing.link_id = stamp, link
    message = message or mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    return framed(message.pack(encoder))


UNSIGNED = framed(
    mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(NoFile(), 255, 190))
)


@pytest.fixture
def wall() -> Wall:
    return Wall()


@pytest.fixture
def verifier(wall: Wall) -> Verifier:
    found = Verifier(StampClock(wall), (KEY, OLD))
    wall.s += 100
    return found


LATER = NOW + 100 * PER_S


def test_each_valid_key_verifies_and_no_other(verifier: Verifier) -> None:
    assert verifier.check(signed(LATER)) is SignatureVerdict.VALID
    assert verifier.check(signed(LATER + 1, OLD)) is SignatureVerdict.VALID
    assert verifier.check(signed(LATER + 2, WRONG)) is SignatureVerdict.FORGED
    assert verifier.check(UNSIGNED) is SignatureVerdict.UNSIGNED


def test_each_damaged_byte_of_a_signature_is_forged(verifier: Verifier) -> None:
    frame = signed(LATER)
    for at in range(1, 14):
        data = bytearray(frame.data)
        data[-at] ^= 1
        assert verifier.check(frame._replace(data=bytes(data))) is SignatureVerdict.FORGED
    assert verifier.check(frame) is SignatureVerdict.VALID


def test_replayed_frame_is_refused(verifier: Verifier) -> None:
    first, second = signed(LATER), signed(LATER + 1)
    assert verifier.check(second) is SignatureVerdict.VALID
    assert verifier.check(second) is SignatureVerdict.REPLAYED
    assert verifier.check(first) is SignatureVerdict.REPLAYED


def test_streams_have_stamps_of_their_own(verifier: Verifier) -> None:
    assert verifier.check(signed(LATER + 5)) is SignatureVerdict.VALID
    assert verifier.check(signed(LATER, link=1)) is SignatureVerdict.VALID
    assert verifier.check(signed(LATER, system=254)) is SignatureVerdict.VALID
    assert verifier.check(signed(LATER - 61 * PER_S, system=253)) is SignatureVerdict.REPLAYED


def test_forged_future_stamp_does_not_lock_the_owner_out(verifier: Verifier) -> None:
    assert verifier.check(signed(LATER)) is SignatureVerdict.VALID
    assert verifier.check(signed((1 << 48) - 1, WRONG)) is SignatureVerdict.FORGED
    assert verifier.check(signed((1 << 48) - 1)) is SignatureVerdict.FUTURE
    assert verifier.check(signed(LATER + 1)) is SignatureVerdict.VALID


def test_stamps_go_on_after_a_restart(tmp_path: Path, wall: Wall) -> None:
    path = tmp_path / "state" / "stamp"
    before = StampClock(wall, path)
    sent = [before.next() for _ in range(3)]
    assert sent == sorted(set(sent))
    frame = signed(NOW + 30 * PER_S)
    assert Verifier(before, (KEY,)).check(frame) is SignatureVerdict.VALID
    wall.s += 1
    after = StampClock(wall, path)
    assert after.next() > NOW + 30 * PER_S
    assert Verifier(after, (KEY,)).check(frame) is SignatureVerdict.REPLAYED
    wall.s += 45
    assert Verifier(after, (KEY,)).check(signed(after.now())) is SignatureVerdict.VALID


def test_clock_that_was_set_back_repeats_no_stamp(tmp_path: Path, wall: Wall) -> None:
    newest = StampClock(wall, tmp_path / "stamp").next()
    wall.s -= 86_400
    assert StampClock(wall, tmp_path / "stamp").next() > newest


@pytest.mark.parametrize(
    "text", [b"\xff-1", b"9" * 5000, str((1 << 48) - 1).encode(), "\u0662\u0663".encode()]
)
def test_damaged_stamp_file_counts_as_none(tmp_path: Path, wall: Wall, text: bytes) -> None:
    (tmp_path / "stamp").write_bytes(text)
    clock = StampClock(wall, tmp_path / "stamp")
    assert clock.floor == NOW
    assert clock.next() < 1 << 48


def test_clock_that_was_set_back_locks_no_client_out(tmp_path: Path, wall: Wall) -> None:
    """Clients set their stamps forward to those of the gateway, as read in pymavlink's source."""
    StampClock(wall, tmp_path / "stamp").next()
    wall.s -= 86_400
    clock = StampClock(wall, tmp_path / "stamp")
    verifier = Verifier(clock, (KEY,))
    for _ in range(100):
        assert verifier.check(signed(clock.next() + 1)) is SignatureVerdict.VALID
    assert verifier.check(signed(clock.newest + 61 * PER_S)) is SignatureVerdict.FUTURE


def test_frames_that_never_arrived_cannot_be_sent_much_later(
    verifier: Verifier, wall: Wall
) -> None:
    recorded = [signed(LATER + 1), signed(LATER + 2)]
    assert verifier.check(signed(LATER)) is SignatureVerdict.VALID
    wall.s += 30
    assert verifier.check(recorded[0]) is SignatureVerdict.VALID
    wall.s += 3600
    assert verifier.check(recorded[1]) is SignatureVerdict.REPLAYED
    assert verifier.check(signed(LATER + 3630 * PER_S)) is SignatureVerdict.VALID


def test_client_whose_stamps_only_count_frames_is_heard(verifier: Verifier, wall: Wall) -> None:
    for number in range(600):
        assert verifier.check(signed(LATER + number)) is SignatureVerdict.VALID
        wall.s += 1


def test_slow_disk_delays_no_stamp(
    tmp_path: Path, wall: Wall, monkeypatch: pytest.MonkeyPatch
) -> None:
    released, written = Event(), list[str]()

    def slow(path: Path, text: str) -> None:
        released.wait(PATIENCE_S)
        written.append(text)

    monkeypatch.setattr(signing, "replace", slow)
    clock = StampClock(wall, tmp_path / "stamp", signing.BackgroundWriter())
    given = [clock.next()]
    for _ in range(10):
        wall.s += 60
        given.append(clock.next())
    assert given == sorted(set(given))
    assert written == []
    released.set()
    until(lambda: len(written) == 1)


ring = KeyRing(key=(SigningKey(secret=KEY.hex()),))


@pytest.mark.parametrize(
    ("policy", "is_loopback", "rights"),
    [
        (Policy.REQUIRE, True, Rights.WATCH),
        (Policy.REQUIRE, False, Rights.WATCH),
        (Policy.LOOPBACK, True, Rights.COMMAND),
        (Policy.LOOPBACK, False, Rights.WATCH),
        (Policy.ACCEPT, False, Rights.COMMAND),
        (Policy.ANYONE, False, Rights.COMMAND),
    ],
)
def test_policy_decides_what_unsigned_frames_may_do(
    wall: Wall, policy: Policy, is_loopback: bool, rights: Rights
) -> None:
    guard, counters, numbers = SigningGuard(wall, ring, {"end": policy}), Counters(), count(NOW + 1)
    found = (
        guard.check(frame, counters, "end", is_loopback=is_loopback)
        for frame in (UNSIGNED, signed(next(numbers)), signed(next(numbers), WRONG))
    )
    assert list(found) == [
        (rights, SignatureVerdict.UNSIGNED),
        (Rights.COMMAND, SignatureVerdict.VALID),
        (Rights.NONE, SignatureVerdict.FORGED),
    ]
    assert (counters.signed, counters.unsigned, counters.refused) == (1, 1, 1)


def test_nothing_forged_or_replayed_or_unsigned_may_command(wall: Wall) -> None:
    guard, counters = SigningGuard(wall, ring, {"end": Policy.REQUIRE}), Counters()
    command = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    valid = signed(NOW + 1, message=command)
    assert guard.check(valid, counters, "end", is_loopback=True)[0] is Rights.COMMAND
    for stamp in range(NOW - 350, NOW + 350):
        for frame in (
            signed(stamp, WRONG, message=command),
            valid,
            signed(NOW + 61 * PER_S + stamp, message=command),
            UNSIGNED,
        ):
            rights, _ = guard.check(frame, counters, "end", is_loopback=True)
            assert rights in (Rights.NONE, Rights.STOP, Rights.WATCH)
    assert (counters.forged, counters.replayed, counters.future) == (700, 700, 700)
