"""Rows 55-57, 64: which ground station is in control; rows 51-54: signed links.

Rows 51-54 are tried only with --signing-key.
"""

from functools import wraps
from typing import Any, Final

from runtime.units import NS_PER_S
from vehicle_check import row_steps
from vehicle_check.ground_stations import GroundStation, result_name
from vehicle_check.mavlink_frames import (
    KEY_LENGTH,
    NOT_IN_CONTROL,
    REQUEST_OPERATOR_CONTROL,
    SYSTEM_MANAGER,
    TAKEOVER_ALLOWED,
    UNITS_PER_S,
    Signer,
    is_signed_with,
    mavlink,
)
from vehicle_check.rows.command_rows import standing
from vehicle_check.rows.log_rows import entries, read_log
from vehicle_check.vehicle_under_test import (
    ONE_CLIENT,
    ROVER,
    Findings,
    Judge,
    RowVerdict,
    VehicleCheck,
    failed,
    not_applicable,
    not_tried,
    row,
)

ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
HOLD: Final = mavlink.ROVER_MODE_HOLD
MANUAL: Final = mavlink.ROVER_MODE_MANUAL
RELEASE: Final = 0
REQUEST: Final = 1
TIMEOUT_S: Final = 10
STOPS: Final = (
    ("mode HOLD", mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD),
    ("193", mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0),
    ("disarming", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0),
)
"""Commands that only stop the vehicle: all but the emergency stop, which ends the row."""
ABSENT: Final = "no CONTROL_STATUS, and 32100 is UNSUPPORTED"


def ask_control(client: GroundStation, action: int, takeover: int = 0) -> int | None:
    """Request or release control; return the result."""
    return client.result_of(
        REQUEST_OPERATOR_CONTROL, action, takeover, TIMEOUT_S, client.system, within_s=2.0
    )


def owner_becomes(check: VehicleCheck, system: int) -> int | None:
    """Wait until CONTROL_STATUS names an owner; return the newest one."""
    check.main.expect_sent("CONTROL_STATUS", 2.5, lambda one: one.gcs_main == system)
    frame = check.main.latest("CONTROL_STATUS")
    return None if frame is None else int(frame.message.gcs_main)


def with_control(judge: Judge) -> Judge:
    """Judge a row unless the vehicle knows nothing of operator control, as ArduPilot 4.7."""

    @wraps(judge)
    def judged(check: VehicleCheck) -> RowVerdict:
        if "control" not in check.facts:
            is_silent = not check.seen("CONTROL_STATUS")
            check.facts["control"] = not (
                is_silent and ask_control(check.main, RELEASE) == mavlink.MAV_RESULT_UNSUPPORTED
            )
        return judge(check) if check.facts["control"] else not_applicable(ABSENT)

    return judged


@row(
    55,
    "CONTROL_STATUS 1 Hz of the system manager, with the owner and whether takeover is allowed",
    suffers="QGroundControl: no indicator of control",
    source="QGroundControl GCSControlManager.cc; MAVLink guide, CONTROL_STATUS",
)
@with_control
def control_status(check: VehicleCheck) -> RowVerdict:
    """Judge rate and flags."""
    found = Findings()
    check.expect_rate(found, "CONTROL_STATUS", 1, 1)
    one = check.newest("CONTROL_STATUS")
    if one is None:
        return failed("no CONTROL_STATUS, also when asked")
    found.expect(one.flags & SYSTEM_MANAGER, f"flags {one.flags}, gcs_main {one.gcs_main}")
    found.expect(not any(one.gcs_secondary), "no secondary owners")
    return found.verdict()


@row(
    56,
    "32100: request, release, takeover; the owner is asked when takeover is not allowed",
    suffers="QGroundControl: control cannot be handed over",
    source="QGroundControl GCSControlManager.cc; MAVLink guide, CONTROL_STATUS",
)
@with_control
def handover(check: VehicleCheck) -> RowVerdict:
    """Take control, refuse it to a second ground station, then allow it."""
    if not check.serves_two:
        return not_applicable(ONE_CLIENT)
    found, main, other = Findings(), check.main, check.second
    result = ask_control(main, REQUEST)
    if result in (None, mavlink.MAV_RESULT_UNSUPPORTED):
        return failed(f"32100: {result_name(result)}")
    owner = owner_becomes(check, main.system)
    found.expect(result == ACCEPTED and owner == main.system, f"request: owner {owner}")
    since = main.mark()
    refused = ask_control(other, REQUEST)
    found.expect(refused == mavlink.MAV_RESULT_FAILED, f"takeover: {result_name(refused)}")
    question = main.expect_sent(
        "COMMAND_LONG", 1.5, lambda one: one.command == REQUEST_OPERATOR_CONTROL, since
    )
    asked = None if question is None else round(question.message.param4)
    found.expect(asked == other.system, f"the owner is asked for {asked}")
    allowed = ask_control(main, REQUEST, takeover=1)
    status = main.expect_sent("CONTROL_STATUS", 2.0, lambda one: one.flags & TAKEOVER_ALLOWED)
    found.expect(allowed == ACCEPTED and status, f"takeover allowed: {result_name(allowed)}")
    taken = ask_control(other, REQUEST)
    owner = owner_becomes(check, other.system)
    found.expect(taken == ACCEPTED and owner == other.system, f"then: owner {owner}")
    released = ask_control(other, RELEASE)
    owner = owner_becomes(check, 0)
    found.expect(released == ACCEPTED and owner == 0, f"release: owner {owner}")
    return found.verdict()


@row(
    57,
    "commands of others are NOT_IN_CONTROL; requests that only read or stop are open to all",
    suffers="two ground stations steer one vehicle",
    source="MAVLink guide, MAV_RESULT_NOT_IN_CONTROL",
)
@with_control
def not_in_control(check: VehicleCheck) -> RowVerdict:
    """Take control, and command from a second ground station."""
    if not check.serves_two:
        return not_applicable(ONE_CLIENT)
    found, main, other = Findings(), check.main, check.second
    taken = ask_control(main, REQUEST)
    if taken != ACCEPTED:
        return failed(f"32100: {result_name(taken)}")
    # Set the speed to its present value: a state-changing command that does not move the vehicle.
    speed = other.result_of(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -1, -1)
    found.expect(speed == NOT_IN_CONTROL, f"178 of another: {result_name(speed)}")
    reads = other.result_of(mavlink.MAV_CMD_REQUEST_MESSAGE, 148)
    found.expect(reads == ACCEPTED, f"512 of another: {result_name(reads)}")
    if check.options.allow_motion:
        for what, number, *params in STOPS:
            stop = other.result_of(number, *params, within_s=2.0)
            found.expect(stop == ACCEPTED, f"{what} of another: {result_name(stop)}")
        stop = other.result_of(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1, within_s=2.0)
        found.expect(stop == ACCEPTED, f"185 of another: {result_name(stop)}")
        main.result_of(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0, within_s=2.0)
    ask_control(main, RELEASE)
    owner_becomes(check, 0)
    return found.verdict()


RESTART_S: Final = 1.0
RESTART_WITH_LOSS_S: Final = 5.0
LATE_S: Final = 2.0
"""How much longer the judge waits, to tell a late answer from none."""
BACK_S: Final = 8.0


@row(
    64,
    "a ground station that starts again commands within 1 s, and is never called another one",
    suffers="users of MAVProxy, MavKit and scripts: locked out by themselves",
    source="MAVLink guide, MAV_RESULT_NOT_IN_CONTROL; MAVProxy",
    profiles=ROVER,
)
@standing
def restarted(check: VehicleCheck) -> RowVerdict:
    """Choose MANUAL, fall silent, and choose it with the same ids from a new port.

    HOLD would prove nothing: a command that stops the vehicle is open to all.
    """
    if check.is_armed:
        return not_tried("the vehicle is armed")
    if not check.serves_two:
        return not_applicable(ONE_CLIENT)
    found, main = Findings(), check.main
    first = check.set_mode(MANUAL)
    found.expect(first == ACCEPTED, f"before: {result_name(first)}")
    main.beats = False
    again = check.station.connect(main.system)
    again.beat(check.station.now_ns)  # as every ground station does before it commands
    most_s = RESTART_WITH_LOSS_S if check.station.is_lossy else RESTART_S
    stopwatch = check.station.stopwatch()
    result = _accepted_within(check, again, most_s + LATE_S)
    elapsed = stopwatch.elapsed
    fact = f"from a new port: {result_name(result)} after {elapsed.seconds:.2f} s"
    if found.expect(result == ACCEPTED, fact):
        found.expect_in_time(elapsed, most_s, fact)
    text = check.texts(0, again)
    found.expect("another" not in text.lower(), f"text {text!r}")
    again.beats, main.beats = False, True
    _accepted_within(check, main, BACK_S)
    return found.verdict()


def _accepted_within(check: VehicleCheck, client: GroundStation, seconds: float) -> int | None:
    """Choose MANUAL until that is accepted; return the last result."""
    stopwatch, result = check.station.stopwatch(), None
    while result != ACCEPTED and stopwatch.elapsed.seconds < seconds:
        left_s = seconds - stopwatch.elapsed.seconds
        result = check.set_mode(MANUAL, client, within_s=min(1.0, left_s))
        if result != ACCEPTED:
            check.station.wait(min(0.2, left_s))
    return result


SET_MODE: Final = mavlink.MAV_CMD_DO_SET_MODE
NEWEST_LOGS: Final = 2
TAIL_BYTES: Final = 30_000
NEEDED: Final = "needs --signing-key FILE"
WRONG_KEY: Final = bytes(range(KEY_LENGTH))
NO_KEY: Final = bytes(KEY_LENGTH)
NEW_KEY: Final = bytes(reversed(range(100, 100 + KEY_LENGTH)))
YEAR_UNITS: Final = 365 * 24 * 3600 * UNITS_PER_S
WITHIN_S: Final = 1.5


def with_key(judge: Judge) -> Judge:
    """Judge a row only if the judge has the key of the link."""

    @wraps(judge)
    def judged(check: VehicleCheck) -> RowVerdict:
        return not_tried(NEEDED) if check.options.key is None else judge(check)

    return judged


@row(
    51,
    "signing: an unsigned client receives telemetry and cannot command",
    suffers="all users of an open line",
    source="MAVLink guide, message signing",
)
@with_key
def stranger(check: VehicleCheck) -> RowVerdict:
    """Send commands without a signature and with a wrong key."""
    found = Findings()
    own = _keep_mode(check, check.main)
    found.expect(own == ACCEPTED, f"signed: {result_name(own)}")
    for name, signer in (("unsigned", None), ("wrong key", Signer(WRONG_KEY, 9, check.stamp()))):
        client = check.station.connect()
        client.signer = signer
        seen = client.greet()
        result = _keep_mode(check, client)
        client.beats = False
        found.expect(result != ACCEPTED, f"{name}: {result_name(result)}")
        is_right = seen is not None or name != "unsigned"
        found.expect(is_right, f"{name} {'sees' if seen else 'does not see'} HEARTBEAT")
    return found.verdict()


def _keep_mode(check: VehicleCheck, client: GroundStation) -> int | None:
    """Choose the mode that the vehicle has: a command that acts, and changes nothing."""
    return check.set_mode(check.mode, client)


def _changed(check: VehicleCheck, client: GroundStation, key: bytes) -> bool:
    """Set a key, twice as QGroundControl does; return True if a heartbeat confirms it."""
    since, asker = check.main.mark(), client.mark()
    target = check.station.address
    for _ in range(check.station.tries):
        message = mavlink.MAVLink_setup_signing_message(*target, list(key), check.stamp())
        for _ in range(2):
            client.send(message)
        if _signed_soon(check, key if any(key) else None, since):
            return True
        if _refused(client, asker):
            break
    return False


def _signed_soon(check: VehicleCheck, key: bytes | None, since: int) -> bool:
    """Wait for a heartbeat signed with a key, or unsigned for None."""

    def is_there() -> bool:
        frames = check.main.sent("HEARTBEAT", since)
        if key is None:
            return any(not frame.is_signed for frame in frames)
        return any(frame.is_signed and is_signed_with(frame.raw, key) for frame in frames)

    return check.station.wait(WITHIN_S, is_there)


@row(
    52,
    "SETUP_SIGNING: confirmed by the next HEARTBEAT; an all-zero key ends signing",
    suffers="QGroundControl confirms on exactly these",
    source="QGroundControl src/MAVLink/Signing/SigningController.cc",
)
@with_key
def setup(check: VehicleCheck) -> RowVerdict:
    """Replace the key and restore the old one.

    Try without rights; end signing, and start it again.
    """
    if check.is_armed:
        return not_tried("the vehicle is armed")
    found = Findings()
    is_new = _changed(check, check.main, NEW_KEY)
    found.expect(is_new, f"HEARTBEAT with the new key: {is_new}")
    if is_new:
        _restore(check, found, NEW_KEY)
    _expect_no_strangers_key(check, found)
    _expect_end(check, found)
    if check.options.allow_motion and row_steps.start(check, row_steps.GUIDED, found):
        since = check.main.mark()
        is_taken = _changed(check, check.main, NEW_KEY)
        found.expect(not is_taken, f"while armed {'taken' if is_taken else 'refused'}")
        found.expect(_refused(check.main, since), f"text {check.texts(since)!r}")
        row_steps.stand(check)
        if is_taken:
            _restore(check, found, NEW_KEY)
    return found.verdict()


def _restore(check: VehicleCheck, found: Findings, present: bytes) -> None:
    """Restore the old key, signed with a present one."""
    old = check.options.key or b""
    check.main.signer = check.signer_with(present) if any(present) else None
    is_old = _changed(check, check.main, old)
    found.expect(is_old, f"HEARTBEAT with the old key: {is_old}")
    check.main.signer = check.signer_with(old)


def _expect_no_strangers_key(check: VehicleCheck, found: Findings) -> None:
    """Send a key without a signature; only a vehicle on this machine may accept it."""
    stranger = check.station.connect()
    stranger.signer = None
    stranger.greet()
    since = stranger.mark()
    if _changed(check, stranger, WRONG_KEY):
        fact = "a stranger's key: taken"
        found.expect(check.station.network.is_loopback, f"{fact} (loopback may)")
        _restore(check, found, WRONG_KEY)
    else:
        text = check.texts(since, stranger)
        found.expect(_refused(stranger, since), f"a stranger's key: refused, text {text!r}")
    stranger.beats = False


def _expect_end(check: VehicleCheck, found: Findings) -> None:
    """End signing by a key of zeros; a vehicle that requires signing may refuse it with a text."""
    since = check.main.mark()
    if _changed(check, check.main, NO_KEY):
        found.fact("a key of zeros: HEARTBEAT unsigned")
        _restore(check, found, NO_KEY)
    else:
        text = check.texts(since)
        found.expect(_refused(check.main, since), f"a key of zeros: text {text!r}")


def _refused(client: GroundStation, since: int) -> bool:
    """Return True after a STATUSTEXT of severity ERROR with the word that QGroundControl needs."""

    def is_refusal(one: Any) -> bool:
        words = one.text if isinstance(one.text, str) else one.text.decode("utf-8", "replace")
        return one.severity <= mavlink.MAV_SEVERITY_ERROR and "signing" in words.lower()

    return bool(client.sent("STATUSTEXT", since, is_refusal))


@row(
    53,
    "SETUP_SIGNING is never forwarded, and its key is in no recording",
    suffers="users who share a recording",
    source="MAVLink guide, message signing",
)
@with_key
def secret(check: VehicleCheck) -> RowVerdict:
    """Look for SETUP_SIGNING at another client, and for the key in the newest logs."""
    found, key = Findings(), check.options.key or b""
    frames = [one for client in check.station.clients.values() for one in client.log]
    forwarded = check.station.forwarded_keys
    found.expect(not forwarded, f"{forwarded} SETUP_SIGNING forwarded")
    leaked = sum(key in frame.raw or NEW_KEY in frame.raw for frame in frames)
    found.expect(not leaked, f"{leaked} frames with a key")
    check.facts.pop("logs", None)  # the newest one has grown
    for number, size in sorted(entries(check).items())[-NEWEST_LOGS:]:
        data = read_log(check, number, max(0, size - TAIL_BYTES), min(size, TAIL_BYTES))
        is_secret = key not in data and NEW_KEY not in data
        fact = f"{'no ' if is_secret else 'a '}key in the last {len(data)} B of log {number}"
        found.expect(is_secret, fact)
    return found.verdict()


@row(
    54,
    "a forged time stamp of the future does not lock the owner out",
    suffers="the owner of the vehicle",
    source="MAVLink guide, message signing",
)
@with_key
def future(check: VehicleCheck) -> RowVerdict:
    """Send frames with a wrong key and a far time stamp, then command with the right one."""
    found = Findings()
    forger = check.station.connect(check.main.system)
    forger.signer = Signer(WRONG_KEY, 1, check.stamp() + YEAR_UNITS)
    for _ in range(5):
        forger.send_surely(forger.command_long(SET_MODE, 1, check.mode))
        check.station.wait(0.1)
    start_ns = check.station.now_ns
    result = _keep_mode(check, check.main)
    seconds = (check.station.now_ns - start_ns) / NS_PER_S
    found.expect(result == ACCEPTED, f"owner: {result_name(result)} after {seconds:.2f} s")
    forger.beats = False
    return found.verdict()
