"""Rows 58-60 and 62: ready in time, two robots at one port, floods, and no loss without one."""

import random
from itertools import pairwise
from typing import Final

from runtime.units import NS_PER_S
from vehicle_check.ground_stations import Elapsed, GroundStation
from vehicle_check.mavlink_frames import UNRELEASED, mavlink, number_of
from vehicle_check.rows.identity_rows import gaps_in, versions
from vehicle_check.rows.parameter_rows import PCK, most_seconds, parameters
from vehicle_check.transfers import (
    FENCE,
    MISSION,
    FileClient,
    download_parameters,
    download_plan,
    unpacked,
)
from vehicle_check.vehicle_under_test import (
    Findings,
    RowVerdict,
    VehicleCheck,
    failed,
    not_applicable,
    passed,
    row,
)

READY_S: Final = 2.0
READY_WITH_LOSS_S: Final = 5.0
CONNECTIONS: Final = 5
MODAL: Final = mavlink.MAV_SEVERITY_ERROR
COMMANDS: Final = 1_000
ANSWERS_S: Final = 3.0
BEHIND_S: Final = 0.2
"""How long the judge waits for a busy vehicle before it sends more commands."""
FLOOD_S: Final = 2.0
FRAMES_PER_STEP: Final = 40
STEP_S: Final = 0.02
KEPT_RATE: Final = 0.8
MAX_GAP_S: Final = 1.6
RADIO_BYTES_PER_S: Final = 4_500


@row(
    58,
    "ready within 2 s of connecting, without an error shown; the whole list at 20 % loss, too",
    suffers="QGroundControl and its users",
    source="QGroundControl InitialConnectStateMachine.cc",
)
def ready(check: VehicleCheck) -> RowVerdict:
    """Connect like QGroundControl: version, modes, parameters, mission, fence, home.

    With loss the time of one connection is chance, so the median of several is judged.
    """
    found, is_lossy = Findings(), check.station.is_lossy
    times = sorted(_time_until_ready(check, found) for _ in range(CONNECTIONS if is_lossy else 1))
    least_s = READY_WITH_LOSS_S if is_lossy else READY_S
    most_s = most_seconds(check, least_s, parameters(check).count)
    of_all = f", the median of {len(times)}, longest {times[-1].seconds:.2f} s" if is_lossy else ""
    middle = times[len(times) // 2]
    fact = f"ready after {middle.seconds:.2f} s{of_all} (wanted {most_s:g})"
    found.expect_in_time(middle, most_s, fact)
    return found.verdict()


def _time_until_ready(check: VehicleCheck, found: Findings) -> Elapsed:
    """Connect once; return the time, and expect all answers and no error shown."""
    stopwatch = check.station.stopwatch()
    client = check.station.connect() if check.serves_two else check.main
    since = client.mark()
    steps = {
        "heartbeat": client.greet(),
        "version": any(versions_of(check, client)),
        "parameters": _has_parameters(client),
        "mission": download_plan(client, MISSION),
        "fence": download_plan(client, FENCE),
        "home": client.heard("HOME_POSITION") or client.request(242, "HOME_POSITION"),
    }
    elapsed = stopwatch.elapsed
    missing = [name for name, step in steps.items() if step is None or step is False]
    found.expect(not missing, f"missing {missing}" if missing else "all answered")
    shown = client.sent("STATUSTEXT", since, where=lambda one: one.severity <= MODAL)
    found.expect(not shown, f"{len(shown)} errors {[one.message.text for one in shown][:2]}")
    client.beats = client is check.main
    return elapsed


def versions_of(check: VehicleCheck, client: GroundStation) -> list[bool]:
    """Return the answered version requests; only the first with QGroundControl's sequence."""
    asked = client.request(148, "AUTOPILOT_VERSION")
    return (
        [asked is not None]
        if asked
        else [one is not None for one in versions(check, client).values()]
    )


def _has_parameters(client: GroundStation) -> bool:
    data = FileClient(client).fetch(PCK, within_s=4.0)
    packed = None if data is None else unpacked(data)
    if packed is not None and len(packed.values) == packed.given:
        return True
    return download_parameters(client, 5.0).is_whole


@row(
    59,
    "two robots at one port: commands for one do not act on the other",
    suffers="fleets behind one address",
    source="MAVLink guide, routing; QGroundControl issue 9858",
)
def two_systems(check: VehicleCheck) -> RowVerdict:
    """Send many commands to the second system; the first must not answer any."""
    check.station.wait(0.2)
    others = sorted(system for system in check.station.systems if system != check.target)
    if not others:
        return not_applicable("one system at this endpoint")
    since, before = check.main.mark(), check.station.acknowledged[others[0]]
    number = mavlink.MAV_CMD_REQUEST_MESSAGE
    acknowledged = check.station.acknowledged
    for step in range(COMMANDS // FRAMES_PER_STEP):
        for _ in range(FRAMES_PER_STEP):
            check.main.send(
                mavlink.MAVLink_command_long_message(others[0], 1, number, 0, 148, *[0] * 6)
            )
        wanted = before + step * FRAMES_PER_STEP
        check.station.wait(STEP_S)
        check.station.wait(BEHIND_S, lambda: acknowledged[others[0]] >= wanted)  # noqa: B023
    check.station.wait(ANSWERS_S, lambda: acknowledged[others[0]] - before >= COMMANDS)
    check.station.wait(0.5)
    strays = check.main.sent("COMMAND_ACK", since, lambda ack: ack.command == number)
    strays += check.main.sent("AUTOPILOT_VERSION", since)
    answered = acknowledged[others[0]] - before
    fact = f"{COMMANDS} commands for {others[0]}: {answered} answers of it"
    fact += f", {len(strays)} of {check.target}"
    return (passed if answered >= COMMANDS // 2 and not strays else failed)(fact)


@row(
    60,
    "a flood of broken and unknown frames does not disturb the streams",
    suffers="every client if one of them or the line is faulty",
    source="MAVLink guide, serialization",
)
def flood(check: VehicleCheck) -> RowVerdict:
    """Send broken, unknown and unaddressed frames; the main client's heartbeats go on."""
    found = Findings()
    chance = random.Random(check.options.seed)
    client = check.station.connect()
    since, start_ns = check.main.mark(), check.station.now_ns
    stopwatch, sent = check.station.stopwatch(), 0
    for _ in range(round(FLOOD_S / STEP_S)):
        for _ in range(FRAMES_PER_STEP):
            client.send_bytes(_broken(client, chance))
            sent += 1
        check.station.wait(STEP_S)
    check.station.wait(1.2)
    seconds, held_up_s = stopwatch.elapsed
    times = [one.at_ns for one in check.main.sent("HEARTBEAT", since)]
    times = [start_ns, *times, check.station.now_ns]
    gap_s = max(second - first for first, second in pairwise(times)) / NS_PER_S
    gap = Elapsed(gap_s, min(gap_s, held_up_s))
    found.expect_in_time(gap, MAX_GAP_S, f"longest gap {gap_s:.2f} s")
    before, name = check.rate("ATTITUDE"), "ATTITUDE"
    count = sum(one.name == name for one in check.main.log[since:])
    fact = f"{name} {count / seconds:.1f} Hz of {before:.1f} with {sent / seconds:.0f} frames/s"
    if found.expect(count, fact):
        # The time in which as many are due at the least rate.
        found.expect_in_time(stopwatch.elapsed, count / (before * KEPT_RATE), fact)
    rate = check.window.bytes_per_s
    found.fact(f"{rate / 1000:.1f} kB/s per client; 57,600 baud carries {RADIO_BYTES_PER_S / 1000}")
    client.beats = False
    return found.verdict()


def _broken(client: GroundStation, chance: random.Random) -> bytes:
    whole = bytearray(client.frame(mavlink.MAVLink_ping_message(1, 2, 250, 1)))
    kind = chance.randrange(4)
    if kind == 0:
        return bytes(whole[: chance.randrange(1, len(whole))])
    if kind == 1:
        whole[chance.randrange(10, len(whole))] ^= 0xFF
        return bytes(whole)
    if kind == 2:
        whole[7:10] = b"\xf0\xff\x7f"
        return bytes(whole)
    return chance.randbytes(chance.randrange(1, 80))


QUIET_S: Final = 60.0


@row(
    62,
    "no client with a released dialect counts a lost frame in 60 s of a clean line",
    suffers="pymavlink, MAVProxy, node-mavlink and QGroundControl: loss on a perfect line",
    source="pymavlink mavutil.py; node-mavlink; ArduPilot issue 33332",
)
def unknown_frames(check: VehicleCheck) -> RowVerdict:
    """Read what a client is sent that only sends heartbeats, with the dialect of pymavlink."""
    found, window = Findings(), check.window
    frames, malformed = window.frames, 0
    seconds = window.seconds
    if check.serves_two:
        client = window.watchers[0]
        seconds = (check.station.now_ns - window.began_ns) / NS_PER_S
        check.station.wait(QUIET_S - seconds)
        seconds = (check.station.now_ns - window.began_ns) / NS_PER_S
        frames, malformed = client.log, client.malformed
    released = mavlink.mavlink_map.keys() - UNRELEASED
    unknown = [one for one in frames if number_of(one.raw) not in released]
    names = sorted({one.name for one in unknown})
    where = "in the dialect of pymavlink"
    fact = f"{len(unknown)} of {len(frames)} frames are not {where}: {names}"
    found.expect(not unknown, fact if unknown else f"{len(frames)} frames {where}")
    found.expect(not malformed, f"{malformed} malformed")
    gaps = gaps_in(frames)
    found.expect(not gaps, f"{gaps} gaps in {seconds:.0f} s")
    return found.verdict()
