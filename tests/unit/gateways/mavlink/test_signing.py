"""Signing: forged, replayed and future frames, the key, its file and its verb."""

import argparse
import json
import traceback
from collections.abc import Callable
from itertools import count
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from checks.harness.until import PATIENCE_S, until
from gateways.mavlink import signing
from gateways.mavlink.clients import ClientLink
from gateways.mavlink.commands.vehicle_commands import SigningSetup
from gateways.mavlink.framing import Deframer, MavFrame
from gateways.mavlink.liveness import HeartbeatStream
from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.mav_vehicle import Face
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.services import face_of
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
from ground.cli.run.signing_keys import arguments, run
from ground.text.output import Output
from ground.user.mavlink_keys import KeyRing, SigningKey, new_key, read_keys, usual_file, write_keys
from protocol.wire.enums import Vehicle as VehicleState
from runtime.errors import ConfigError, UserError
from runtime.units import NS_PER_S
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, Bench, acks, command, status, words

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
    encoder = mavlink.MAVLink(None, system, 190)
    encoder.signing.secret_key, encoder.signing.sign_outgoing = key, True
    encoder.signing.timestamp, encoder.signing.link_id = stamp, link
    message = message or mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    return framed(message.pack(encoder))


UNSIGNED = framed(
    mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 255, 190))
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


NEW = bytes(range(32))
LOCAL, REMOTE = CLIENT, CLIENT._replace(is_loopback=False, barred=WATCHER)
SIGNED = CLIENT._replace(is_loopback=False, is_signed=True)


class SetupBench(Bench):
    def __init__(self, policy: Policy = Policy.LOOPBACK) -> None:
        super().__init__()
        self.saved: list[KeyRing] = []
        self.guard = SigningGuard(
            lambda: NOW_S * 10**9 + self.now_ns, ring, {"end": policy}, save=self.save
        )
        setup = SigningSetup(self.vehicle, self.guard)
        self.face = Face(self.vehicle, [HeartbeatStream(self.vehicle), setup])
        self.port.telemetry["status"] = status()
        self.after(0.02)
        self.link = ClientLink(1, "peer", 0)
        self.error: UserError | None = None

    def save(self, changed: KeyRing) -> None:
        if self.error is not None:
            raise self.error
        self.saved.append(changed)

    def set_key(self, key: bytes, sender: Any) -> str:
        setup = mavlink.MAVLink_setup_signing_message(1, 1, list(key), 0)
        return words(self.send(setup, sender))

    def next_heartbeat(self) -> MavFrame:
        (found,) = (one for one in self.after(1.0) if one.get_type() == "HEARTBEAT")
        return framed(self.link.encode(1, found, self.guard))


def is_valid(frame: MavFrame, key: bytes) -> bool:
    receiver = mavlink.MAVLink(None)
    receiver.signing.secret_key = key
    try:
        receiver.decode(bytearray(frame.data))
    except mavlink.MAVError:
        return False
    return frame.is_signed


@each("sender", [LOCAL, SIGNED])
def test_key_of_a_disarmed_robot_is_replaced(sender: Any) -> None:
    bench = SetupBench()
    assert is_valid(bench.next_heartbeat(), KEY)
    assert bench.set_key(NEW, sender) == ""
    frame = bench.next_heartbeat()
    assert is_valid(frame, NEW)
    assert not is_valid(frame, KEY)
    assert [[key.raw for key in one.key] for one in bench.saved] == [[NEW]]
    assert bench.set_key(NEW, sender) == ""
    assert len(bench.saved) == 1


def test_key_of_zeros_ends_signing() -> None:
    bench = SetupBench()
    assert bench.set_key(bytes(32), LOCAL) == ""
    assert not bench.next_heartbeat().is_signed
    assert bench.saved == [KeyRing()]


def severity_and_words(messages: list[MavMessage]) -> tuple[int, str]:
    return next(one.severity for one in messages if one.get_type() == "STATUSTEXT"), words(messages)


@each("state", [VehicleState.ACTIVE, None])
def test_key_of_an_armed_or_silent_robot_stays(state: VehicleState | None) -> None:
    bench = SetupBench()
    bench.port.telemetry["status"] = None if state is None else status(vehicle=state)
    bench.after(0.02)
    setup = mavlink.MAVLink_setup_signing_message(1, 1, list(NEW), 0)
    severity, text = severity_and_words(bench.send(setup, LOCAL))
    assert severity == mavlink.MAV_SEVERITY_ERROR
    assert "signing" in text
    assert not bench.saved


def test_key_stays_while_another_robot_of_the_gateway_is_armed() -> None:
    bench, other = SetupBench(), Bench(system=2)
    other.face = Face(other.vehicle, [SigningSetup(other.vehicle, bench.guard)])
    other.port.telemetry["status"] = status(vehicle=VehicleState.ACTIVE)
    other.after(0.02)
    assert "signing" in bench.set_key(NEW, LOCAL)
    assert not bench.saved
    other.port.telemetry["status"] = status()
    other.after(0.02)
    bench.after(1.0)
    assert bench.set_key(NEW, LOCAL) == ""


def test_stranger_sets_no_key() -> None:
    bench = SetupBench()
    assert "signing" in bench.set_key(NEW, REMOTE)
    bench.after(1.0)
    assert "signing" in bench.set_key(bytes(32), LOCAL._replace(barred=WATCHER))
    assert not bench.saved
    assert is_valid(bench.next_heartbeat(), KEY)


def test_required_signing_cannot_be_ended_by_a_client() -> None:
    bench = SetupBench(Policy.REQUIRE)
    assert "signing" in bench.set_key(bytes(32), SIGNED)
    assert not bench.saved


def test_key_that_cannot_be_saved_is_not_used() -> None:
    bench = SetupBench()
    bench.error = UserError("disk full")
    assert "signing: disk full" in bench.set_key(NEW, LOCAL)
    assert is_valid(bench.next_heartbeat(), KEY)


def test_client_without_rights_reads_and_changes_nothing() -> None:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.port.telemetry["status"] = status()
    bench.face.join(REMOTE.client)
    assert any(one.get_type() == "HEARTBEAT" for one in bench.after(1.0))
    assert acks(bench.send(command(512, 148), REMOTE)) == [(512, 0)]
    refused = (
        mavlink.MAVLink_param_set_message(1, 1, b"D_OBS_M", 0.5, 9),
        mavlink.MAVLink_mission_count_message(1, 1, 3, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
        mavlink.MAVLink_mission_set_current_message(1, 1, 1),
        mavlink.MAVLink_set_gps_global_origin_message(1, 10, 10, 0),
        mavlink.MAVLink_manual_control_message(1, 500, 500, 0, 0, 0),
        mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8),
        mavlink.MAVLink_log_erase_message(1, 1),
    )
    for message in refused:
        bench.after(1.0)
        bench.send(message, REMOTE)
    for number in (400, 176, 185, 192, 20, 300, 21, 246, 179, 32100):
        ((_, result),) = acks(bench.send(command(number, 1), REMOTE))
        assert result in (2, 3), number
    bench.after(1.0)
    assert not [one for one in bench.port.performed if one.moves]
    assert not bench.port.leases
    assert not bench.port.stops
    assert not bench.port.driven


def test_keys_are_written_for_the_owner_only(tmp_path: Path) -> None:
    path, ring = tmp_path / "config" / "keys.toml", KeyRing(key=(new_key(), new_key()))
    write_keys(path, ring)
    assert path.stat().st_mode & 0o777 == 0o600
    assert read_keys(path) == ring
    assert read_keys(tmp_path / "none.toml") == KeyRing()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660])
def test_keys_that_others_may_read_are_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "keys.toml"
    write_keys(path, KeyRing(key=(new_key(),)))
    path.chmod(mode)
    with pytest.raises(UserError, match="chmod 600"):
        read_keys(path)


def test_text_of_a_key_has_no_secret() -> None:
    key = new_key()
    for text in (repr(key), str(key), f"{KeyRing(key=(key,))}", key.name):
        assert key.secret not in text
        assert key.passphrase not in text


def test_key_is_the_hash_of_its_passphrase() -> None:
    """As MAVProxy, Mission Planner and QGroundControl make it, as read in the source."""
    from hashlib import sha256

    key = new_key()
    assert key.raw == sha256(key.passphrase.encode()).digest()
    assert key != new_key()


@pytest.mark.parametrize("text", ["[[key]]\nsecret = 'abc'\n", "[[key]]\nsecrt = ''\n"])
def test_damaged_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "keys.toml"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(ConfigError):
        read_keys(path)


@each(
    "damage",
    [
        lambda text: text.replace('"\n', "\n", 1),
        lambda text: text.replace("secret = ", "secrt = ", 1),
        lambda text: text.replace("secret", "secret = secret", 1),
        lambda text: text.replace("[[key]]", "[[key]", 1),
        lambda text: text.replace('secret = "', 'secret = "X', 1),
        lambda text: text + text.replace("[[key]]", "[key]"),
        lambda text: text * 3,
    ],
)
def test_error_about_a_damaged_file_has_no_secret(
    tmp_path: Path, damage: Callable[[str], str]
) -> None:
    """Nor has its traceback: it goes to a terminal, and to the log of `up`."""
    path, key = tmp_path / "keys.toml", new_key()
    write_keys(path, KeyRing(key=(key,)))
    path.write_text(damage(path.read_text()))
    with pytest.raises(UserError) as caught:
        read_keys(path)
    text = "".join(traceback.format_exception(caught.value))
    assert key.secret not in text
    assert key.passphrase not in text


def test_usual_file_is_in_the_folder_of_the_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", "/somewhere")
    assert usual_file() == Path("/somewhere/sidestep/mavlink-keys.toml")
    assert SigningKey(secret="0" * 64).raw == bytes(32)


def test_folder_is_no_file_of_keys(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is not a file"):
        read_keys(tmp_path)


class Verb:
    def __init__(self, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.path, self._capsys = path, capsys

    def __call__(self, *words: str, as_json: bool = False) -> str:
        parser = argparse.ArgumentParser()
        arguments(parser)
        options = parser.parse_args([*words, "--file", str(self.path)])
        assert run(options, Output(as_json=as_json)) == 0
        return self._capsys.readouterr().out

    @property
    def secrets(self) -> list[str]:
        ring = read_keys(self.path)
        return [text for key in ring.key for text in (key.secret, key.passphrase)]


@pytest.fixture
def verb(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Verb:
    return Verb(tmp_path / "keys.toml", capsys)


def test_rotation_keeps_the_old_key_until_it_is_retired(verb: Verb) -> None:
    printed = verb("show") + verb("new")
    (first,) = read_keys(verb.path).key
    printed += verb("show") + verb("rotate") + verb("show")
    second, kept = read_keys(verb.path).key
    assert kept == first != second
    assert not [text for text in verb.secrets if text in printed]
    printed = verb("retire")
    assert read_keys(verb.path).key == (second,)
    assert not [text for text in verb.secrets if text in printed]


def test_secret_is_printed_only_on_request(verb: Verb) -> None:
    verb("new")
    assert all(text in verb("show", "--secret") for text in verb.secrets)
    row = json.loads(verb("show", "--secret", as_json=True))
    assert [row["keys"][0]["key"], row["keys"][0]["passphrase"]] == verb.secrets
    assert "key" not in json.loads(verb("show", as_json=True))["keys"][0]


@pytest.mark.parametrize(
    ("steps", "fix"),
    [
        (("new", "new"), "signing rotate"),
        (("rotate",), "signing new"),
        (("new", "rotate", "rotate"), "signing retire"),
        (("new", "retire"), "no old key"),
    ],
)
def test_wrong_order_is_refused_with_the_fix(verb: Verb, steps: tuple[str, ...], fix: str) -> None:
    for step in steps[:-1]:
        verb(step)
    with pytest.raises(UserError, match=fix):
        verb(steps[-1])


def test_secret_only_with_show(verb: Verb) -> None:
    with pytest.raises(UserError, match="keys signing show"):
        verb("new", "--secret")
