"""Make a short recording, as .tlog or .mcap, of a robot that drives along x."""

import json
from pathlib import Path

import msgspec

from ground.recording.log_reader import record_bytes
from ground.recording.mcap_file import McapFormat
from protocol.topics import DRIVE, ODOMETRY, Role, sender_of
from protocol.wire.codec import Encoder
from protocol.wire.messages import PlanarOdometry, WheelCommand
from tests.support.tui.fakes import MS, S
from tests.support.tui.underway import drive_messages

BEGAN_US = 1_700_000_000_000_000
PERIOD_MS = 50


PARAMETERS = {"radius_m": 0.12, "sonar_max_m": 3.0, "guard_stop_m": 0.04}


def recorded(folder: Path, seconds: float = 4.0, suffix: str = ".tlog") -> Path:
    """Write the file; each tick of 50 ms ends with a wheel command. An .mcap has parameters."""
    path = folder / f"20231114T221320Z-r1{suffix}"
    form = McapFormat("r1", {}, BEGAN_US)
    form.add_fact(
        "parameters", json.dumps([{"name": n, "value": v} for n, v in PARAMETERS.items()])
    )
    tlog = b""
    encoders = {role: Encoder(*sender_of(role, "r1")) for role in Role}
    for tick in range(round(seconds * 1000 / PERIOD_MS)):
        now_ns, time_us = 20 * S + tick * PERIOD_MS * MS, BEGAN_US + tick * PERIOD_MS * 1000
        messages = drive_messages(now_ns)
        odometry = messages[ODOMETRY]
        assert isinstance(odometry, PlanarOdometry)
        messages[ODOMETRY] = msgspec.structs.replace(odometry, x_m=0.02 * tick)
        messages[DRIVE] = WheelCommand(
            time_ns=now_ns, seq=tick, sense_seq=tick, left_mrad_s=0, right_mrad_s=0, ttl_ms=150
        )
        for topic, message in messages.items():
            frame = encoders[topic.publisher].encode(message)
            tlog += record_bytes(time_us, frame)
            form.add(topic.key("r1"), frame, time_us)
    path.write_bytes(tlog if suffix == ".tlog" else form.end())
    return path
