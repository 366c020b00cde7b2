"""Make a short recording, as a .tlog, of a robot that drives along x."""

from pathlib import Path

import msgspec

from ground.recording.tlog import record_bytes
from protocol.sender import sender_of
from protocol.topics import DRIVE, ODOMETRY, Role
from protocol.wire.codec import Encoder
from protocol.wire.messages import PlanarOdometry, WheelCommand
from tests.support.tui.fakes import MS, S
from tests.support.tui.underway import drive_messages

BEGAN_US = 1_700_000_000_000_000
PERIOD_MS = 50


def recorded(folder: Path, seconds: float = 4.0) -> Path:
    """Write the file; each tick of 50 ms ends with a wheel command."""
    path = folder / "20231114T221320Z-r1.tlog"
    encoders = {role: Encoder(*sender_of(role, "r1")) for role in Role}
    with path.open("wb") as file:
        for tick in range(round(seconds * 1000 / PERIOD_MS)):
            now_ns = 20 * S + tick * PERIOD_MS * MS
            messages = drive_messages(now_ns)
            odometry = messages[ODOMETRY]
            assert isinstance(odometry, PlanarOdometry)
            messages[ODOMETRY] = msgspec.structs.replace(odometry, x_m=0.02 * tick)
            messages[DRIVE] = WheelCommand(
                time_ns=now_ns, seq=tick, sense_seq=tick, left_mrad_s=0, right_mrad_s=0, ttl_ms=150
            )
            for topic, message in messages.items():
                frame = encoders[topic.publisher].encode(message)
                file.write(record_bytes(BEGAN_US + tick * PERIOD_MS * 1000, frame))
    return path
