"""`up --mavlink`: pymavlink's own client sees the robot drive, and stops it.

In between the gateway is killed: `up` starts it again, and the client goes on with it.
"""

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from gateways.mavlink.mavlink_dialect import mavlink
from tests.support.stack.mavlink_client import LOCAL, MavlinkClient, free_port
from tests.support.stack.processes import Crew

pytestmark = pytest.mark.stack
SLOW_DRIVE = ("up", "--headless", "--speed", "0.3")
"""So that it lasts until a busy computer has started the gateway again."""


def gateway_of(parent: int) -> int:
    """Return the process id of the gateway that `up` has started."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    lines = {int(child): Path(f"/proc/{child}/cmdline").read_bytes() for child in children}
    (found,) = (child for child, line in lines.items() if b"gateway" in line)
    return found


def is_driving(heartbeat: Any) -> bool:
    armed = heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    return bool(armed) and heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


@pytest.mark.brief
def test_client_of_up_sees_the_drive_and_stops_it() -> None:
    port = free_port()
    with Crew() as crew:
        up = crew.start(*SLOW_DRIVE, "--mavlink", f"udpin:{LOCAL}:{port}")
        client = MavlinkClient(port)
        client.next("HEARTBEAT", is_driving)
        first = client.next("GLOBAL_POSITION_INT")
        second = client.next("GLOBAL_POSITION_INT", lambda one: one.lon != first.lon)
        gateway = gateway_of(up.process.pid)
        os.kill(gateway, signal.SIGKILL)
        up.says("the gateway process was killed (signal SIGKILL); restarting")
        client.next("HEARTBEAT", is_driving)
        client.next("GLOBAL_POSITION_INT", lambda one: one.lon != second.lon)
        assert gateway_of(up.process.pid) != gateway
        assert client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0) == 0
        client.link.close()
        assert up.ends() == 1
        assert "emergency stop" in up.said
        assert "Traceback" not in up.said, up.said
