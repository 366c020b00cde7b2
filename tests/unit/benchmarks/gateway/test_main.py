"""The gateway's benchmark: what its clients and attackers send, and what it counts."""

from argparse import ArgumentParser
from collections import Counter
from time import time_ns

import pytest

from checks.speed.gateway import frame_flood, gateway_figures, reactions
from checks.speed.gateway.flood_sender import KINDS as FLOODS
from checks.speed.gateway.flood_sender import SUPPLY, supply_of
from checks.speed.gateway.forgery import KINDS, Forger, NoFile, command, sign
from checks.speed.gateway.frame_flood import FrameFloodRun
from checks.speed.gateway.reactions import first_ns
from checks.speed.gateway.stage import PER_S, FrameArrival, position_target, stamp_now
from gateways.mavlink.framing import Deframer, MavFrame
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.motion.setpoints import Velocity, attitude_of, setpoint_of
from gateways.mavlink.signing import SignatureVerdict, StampClock, Verifier
from ground.client.goal import Destination
from ground.missions.mission import Home
from protocol.wire.messages import WheelCommand
from runtime.units import NS_PER_S
from tests.support.each import each

KEY = bytes(range(100, 132))
HOME = Home(latitude_deg=-35.0, longitude_deg=149.0)


def wheels(left_mrad_s: int) -> WheelCommand:
    return WheelCommand(
        time_ns=1, seq=1, sense_seq=1, left_mrad_s=left_mrad_s, right_mrad_s=0, ttl_ms=150
    )


def frames_in(data: list[bytes]) -> tuple[list[MavFrame], Deframer]:
    found: list[MavFrame] = []
    deframer = Deframer()
    for one in data:
        deframer.allowance = 10_000
        deframer.feed(one)
        found += deframer.take(0)
    return found, deframer


def owners(*stamps: int) -> list[bytes]:
    encoder = mavlink.MAVLink(NoFile(), 255, 190)
    found = []
    for stamp in stamps:
        sign(encoder, KEY, stamp, 0)
        found.append(bytes(command(mavlink.MAV_CMD_MISSION_START).pack(encoder)))
    return found


def test_every_part_can_be_selected() -> None:
    parser = ArgumentParser()
    gateway_figures.add_options(parser)
    assert parser.parse_args(["--parts", "goto", "cost"]).parts == ["goto", "cost"]
    assert set(parser.parse_args([]).parts) == set(gateway_figures.PARTS)


def test_first_wheel_command_that_turns_after_the_send_counts() -> None:
    seen = [(wheels(5), 10), (wheels(0), 20), (wheels(7), 30)]
    assert first_ns(seen, 15) == 30
    assert first_ns(seen, 30) is None


def test_position_target_is_the_place_in_the_robots_world() -> None:
    found = setpoint_of(position_target(3.0, 2.0), None, HOME)
    assert found == Destination(x_m=3.0, y_m=2.0, heading_rad=None)


def test_setpoints_drive_ahead() -> None:
    assert setpoint_of(reactions.velocity(1.0), None, HOME) == Velocity(0.4)
    assert attitude_of(reactions.attitude(0.5), 0.4).speed_m_s == pytest.approx(0.2)
    assert reactions.stick(-1.0).z == -1000
    assert reactions.channels(1.0).chan3_raw == 2000


@each("kind", KINDS)
def test_no_forged_frame_is_valid(kind: str) -> None:
    captured = owners(*(stamp_now() + number for number in range(1, 20)))
    clock = StampClock(time_ns)
    verifier = Verifier(clock, (KEY,))
    verifier.check(frames_in(captured)[0][-1])
    forged = list(Forger(KEY, captured, (1, 1)).frames(kind, 60))
    found, _ = frames_in(forged)
    assert SignatureVerdict.VALID not in {verifier.check(frame) for frame in found}
    assert len(found) == (60 if kind != "truncated" else len(found))
    (good,) = frames_in(owners(stamp_now() + PER_S))[0]
    assert verifier.check(good) is SignatureVerdict.VALID


@each("kind", FLOODS)
def test_floods_are_what_they_are_called(kind: str) -> None:
    found, deframer = frames_in(supply_of(kind))
    counts = {"valid": len(found), "broken": deframer.malformed, "unknown": deframer.unknown}
    assert counts[kind] >= SUPPLY * 0.6
    assert kind == "valid" or len(found) < SUPPLY * 0.2


def test_flood_holds_no_command_that_all_may_give() -> None:
    decoder = mavlink.MAVLink(NoFile())
    names = Counter(
        (message.get_type(), getattr(message, "command", 0))
        for message in (decoder.decode(bytearray(frame)) for frame in supply_of("valid"))
    )
    assert ("COMMAND_LONG", mavlink.MAV_CMD_DO_FLIGHTTERMINATION) not in names
    assert ("PARAM_REQUEST_READ", 0) in names


def test_most_bytes_of_any_second_are_found() -> None:
    times_s = (0.0, 0.5, 1.2, 1.3, 1.4, 3.0)
    arrivals = [FrameArrival(round(at_s * NS_PER_S), 0, 100) for at_s in times_s]
    assert gateway_figures.most_in_a_second(arrivals) == 400


def test_slow_line_that_is_silent_for_long_misses() -> None:
    number = mavlink.MAVLINK_MSG_ID_HEARTBEAT
    arrivals = [FrameArrival(at_s * NS_PER_S, number, 21) for at_s in (0, 1, 4)]
    longest = next(
        one
        for one in gateway_figures.figures_of("line", arrivals)
        if one.name == "line: between HEARTBEAT, longest"
    )
    assert longest.values == (3.0,)
    assert longest.met is False


def test_missed_tick_in_a_flood_misses() -> None:
    figures = frame_flood.figures_of("mixed", FrameFloodRun(missed=1, ticks=100, stops_ms=[80.0]))
    assert [one.name for one in figures if one.met is False] == ["mixed: ticks missed of 100"]
