"""Wheels at rest after the last setpoint of a client that falls silent, beyond its time-out."""

import argparse
from collections.abc import Callable, Mapping
from random import Random
from threading import Event
from time import monotonic
from typing import Final, NamedTuple

from checks.harness.figures import Figure
from checks.harness.motion import PERIOD_S, Seen, stood_s
from checks.harness.until import until
from checks.speed.gateway.client import Client
from checks.speed.gateway.stage import FORCED, Air, Figures, on_air
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from protocol.wire.enums import Mode
from runtime.units import NS_PER_S

AFTER_AT_MOST_MS: Final = 200.0
EVERY_S: Final = 0.1
DRIVES_S: Final = 1.2
FAST_M_S: Final = 0.1
RECENT: Final = 40
"""Samples whose least delay gives the offset of the plant's clock."""
NEWEST: Final = 200
"""Samples that are looked at: ten seconds."""
VELOCITY_MASK: Final = 0b1101_1100_0111
"""A SET_POSITION_TARGET with a velocity only."""
ATTITUDE_MASK: Final = 0b0000_0011
FULL: Final = 1000
UNCHANGED: Final = 0xFFFF


class Setpoint(NamedTuple):
    """A way to drive: the mode, the time-out, and the message for a share of the full speed."""

    mode: Mode
    timeout_s: float
    message: Callable[[float], MavMessage]


def velocity(share: float) -> MavMessage:
    """Return a SET_POSITION_TARGET_LOCAL_NED along the robot's own axis."""
    frame = mavlink.MAV_FRAME_BODY_NED
    speed_m_s = 0.4 * share
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, VELOCITY_MASK, 0.0, 0.0, 0.0, speed_m_s, *(0.0,) * 7
    )


def attitude(share: float) -> MavMessage:
    """Return a SET_ATTITUDE_TARGET with a thrust and no turn."""
    level = [1.0, 0.0, 0.0, 0.0]
    return mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, ATTITUDE_MASK, level, 0.0, 0.0, 0.0, share
    )


def stick(share: float) -> MavMessage:
    """Return a MANUAL_CONTROL."""
    return mavlink.MAVLink_manual_control_message(1, 0, 0, round(FULL * share), 0, 0)


def channels(share: float) -> MavMessage:
    """Return an RC_CHANNELS_OVERRIDE."""
    drive = round(1500 + 500 * share)
    return mavlink.MAVLink_rc_channels_override_message(
        1, 1, 1500, UNCHANGED, drive, *(0xFFFF,) * 5
    )


SETPOINTS: Final[Mapping[str, Setpoint]] = {
    "SET_POSITION_TARGET": Setpoint(Mode.GUIDED, 1.0, velocity),
    "SET_ATTITUDE_TARGET": Setpoint(Mode.GUIDED, 1.0, attitude),
    "MANUAL_CONTROL": Setpoint(Mode.MANUAL, 0.5, stick),
    "RC_CHANNELS_OVERRIDE": Setpoint(Mode.MANUAL, 1.0, channels),
}


def timeout_figures(options: argparse.Namespace) -> Figures:
    """Let each kind of setpoint end several times, at random phases."""
    figures, random = [], Random(1)
    with on_air() as air, Client(air.line()) as client:
        client.await_vehicle()
        client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, FORCED)
        for name, setpoint in SETPOINTS.items():
            times = tuple(
                after_ms(air, client, setpoint, random.random()) for _ in range(options.stops)
            )
            title = f"{name}: time-out to wheels at rest"
            figures += [
                Figure(name=title, unit="ms", values=times),
                Figure(
                    name=f"{title}, worst of {len(times)}",
                    unit="ms",
                    values=(max(times),),
                    at_most=AFTER_AT_MOST_MS,
                ),
            ]
    return figures, [
        "time-outs: the plant's truth, first period without motion; negative: the wheels stood"
        " before the time-out, which is 1 s after the last message received, 0.5 s for"
        " MANUAL_CONTROL",
    ]


def after_ms(air: Air, client: Client, setpoint: Setpoint, phase: float) -> float:
    """Drive, fall silent, and return the time in ms from the time-out to wheels at rest."""
    pause = Event()
    client.set_mode(setpoint.mode)
    heads_on = air.observer.truths[-1][0].x_m < 3.0
    share = 1.0 if heads_on else -1.0
    until_s, sent_ns = monotonic() + DRIVES_S + phase * PERIOD_S, 0
    while monotonic() < until_s:
        sent_ns = client.send(setpoint.message(share))
        pause.wait(EVERY_S)
    until(lambda: stood_s(since(air, sent_ns)) is not None, "wheels at rest", 10.0)
    seen = since(air, sent_ns)
    if abs(seen[0].truth.speed_m_s) < FAST_M_S:
        raise RuntimeError(f"the robot did not drive: {client.texts[-3:]}")
    stood = stood_s(seen)
    return ((stood or 0.0) - setpoint.timeout_s) * 1e3


def since(air: Air, sent_ns: int) -> list[Seen]:
    """Return the motion from a moment on, by the plant's stamps, which no network delays."""
    truths = tuple(air.observer.truths)[-NEWEST:]
    early = [(one, at_ns) for one, at_ns in truths if at_ns < sent_ns][-RECENT:]
    offset_ns = min(at_ns - one.time_ns for one, at_ns in early)
    rows = [Seen((one.time_ns + offset_ns - sent_ns) / NS_PER_S, one) for one, _ in truths]
    return [one for one in rows if one.at_s > 0.0]
