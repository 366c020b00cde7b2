"""Rows 51-54: signed links; only with --signing-key."""

from collections.abc import Callable
from functools import wraps
from typing import Final

from ground.vehicle_check.check import Check
from ground.vehicle_check.dialect import mavlink
from ground.vehicle_check.rows.log_rows import entries
from ground.vehicle_check.session import result_name
from ground.vehicle_check.signing import (
    KEY_LENGTH,
    UNITS_PER_S,
    Signer,
    is_signed_with,
    timestamp_at,
)  # fmt: skip
from ground.vehicle_check.verdict import Findings, Verdict, not_tried, row
from runtime.units import NS_PER_S

ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
SPEED: Final = mavlink.MAV_CMD_DO_CHANGE_SPEED
NEEDED: Final = "needs --signing-key FILE"
WRONG_KEY: Final = bytes(range(KEY_LENGTH))
NEW_KEY: Final = bytes(reversed(range(100, 100 + KEY_LENGTH)))
YEAR_UNITS: Final = 365 * 24 * 3600 * UNITS_PER_S
WITHIN_S: Final = 1.5
Judge = Callable[[Check], Verdict]


def with_key(judge: Judge) -> Judge:
    """Judge a row only if the judge has the key of the link."""

    @wraps(judge)
    def judged(check: Check) -> Verdict:
        return not_tried(NEEDED) if check.options.key is None else judge(check)

    return judged


def stamp(check: Check) -> int:
    """Return the time stamp of a signature now."""
    return timestamp_at(check.options.unix_s + check.spent_s)


@row(
    51,
    "signing: a stranger sees telemetry and commands nothing",
    suffers="everyone near an open line",
)
@with_key
def stranger(check: Check) -> Verdict:
    """Send commands without a signature and with a wrong key."""
    found = Findings()
    own = check.main.result_of(SPEED, 1, -1, -1)
    found.expect(own == ACCEPTED, f"signed: {result_name(own)}")
    for name, signer in (("unsigned", None), ("wrong key", Signer(WRONG_KEY, 9, stamp(check)))):
        client = check.station.connect()
        client.signer = signer
        seen = client.expect("HEARTBEAT", 2.0)
        result = client.result_of(SPEED, 1, -1, -1)
        client.beats = False
        found.expect(result != ACCEPTED, f"{name}: {result_name(result)}")
        is_right = seen is not None or name != "unsigned"
        found.expect(is_right, f"{name} {'sees' if seen else 'does not see'} HEARTBEAT")
    return found.verdict()


def _setup(check: Check, key: bytes) -> None:
    target = check.target, check.station.target_component
    message = mavlink.MAVLink_setup_signing_message(*target, list(key), stamp(check))
    for _ in range(2):
        check.main.send(message)


def _signed_soon(check: Check, key: bytes | None) -> bool:
    """Wait for a heartbeat signed with a key, or unsigned for None."""
    since = check.main.mark()

    def is_there() -> bool:
        frames = check.main.heard("HEARTBEAT", since)
        if key is None:
            return any(not one.is_signed for one in frames)
        return any(one.is_signed and is_signed_with(one.raw, key) for one in frames)

    return check.station.wait(WITHIN_S, is_there)


@row(
    52,
    "SETUP_SIGNING: confirmed by the next HEARTBEAT; an all-zero key ends signing",
    suffers="QGroundControl confirms on exactly these",
)
@with_key
def setup(check: Check) -> Verdict:
    """Exchange the key, and set the old one again."""
    if check.is_armed:
        return not_tried("the vehicle is armed")
    found, old = Findings(), check.options.key or b""
    check.facts["other mark"] = check.second.mark()
    _setup(check, NEW_KEY)
    is_new = _signed_soon(check, NEW_KEY)
    found.expect(is_new, f"HEARTBEAT with the new key: {is_new}")
    if is_new:
        check.main.signer = Signer(NEW_KEY, 1, stamp(check))
        _setup(check, old)
        is_old = _signed_soon(check, old)
        found.expect(is_old, f"HEARTBEAT with the old key: {is_old}")
    check.main.signer = Signer(old, 1, stamp(check))
    stranger = check.station.connect()
    stranger.signer = None
    target = check.target, check.station.target_component
    since = stranger.mark()
    stranger.send(mavlink.MAVLink_setup_signing_message(*target, list(WRONG_KEY), stamp(check)))
    check.station.wait(1.2)
    frames = check.main.heard(
        "HEARTBEAT", check.main.mark() - 200 if check.main.mark() > 200 else 0
    )
    is_taken = any(one.is_signed and is_signed_with(one.raw, WRONG_KEY) for one in frames)
    found.expect(not is_taken, f"a stranger's key: {'taken' if is_taken else 'refused'}")
    found.fact(f"text {check.texts(since, stranger)!r}")
    stranger.beats = False
    return found.verdict()


@row(
    53,
    "SETUP_SIGNING is never forwarded, and its key is in no recording",
    suffers="anyone who shares a recording",
)
@with_key
def secret(check: Check) -> Verdict:
    """Look for SETUP_SIGNING at another client, and for the key in the newest log."""
    found, key = Findings(), check.options.key or b""
    frames = [one for client in check.station.clients.values() for one in client.log]
    forwarded = check.station.forwarded_keys
    found.expect(not forwarded, f"{forwarded} SETUP_SIGNING forwarded")
    leaked = sum(key in one.raw or NEW_KEY in one.raw for one in frames)
    found.expect(not leaked, f"{leaked} frames with a key; {len(entries(check))} logs")
    return found.verdict()


@row(
    54,
    "a forged time stamp of the future does not lock the owner out",
    suffers="the owner of the vehicle",
)
@with_key
def future(check: Check) -> Verdict:
    """Send frames with a wrong key and a far time stamp, then command with the right one."""
    found = Findings()
    forger = check.station.connect(check.main.system)
    forger.signer = Signer(WRONG_KEY, 1, stamp(check) + YEAR_UNITS)
    for _ in range(5):
        forger.send(forger.command_long(SPEED, 1, -1, -1))
        check.station.wait(0.1)
    start_ns = check.station.now_ns
    result = check.main.result_of(SPEED, 1, -1, -1)
    seconds = (check.station.now_ns - start_ns) / NS_PER_S
    found.expect(result == ACCEPTED, f"owner: {result_name(result)} after {seconds:.2f} s")
    forger.beats = False
    return found.verdict()
