"""`up --mavlink`: pymavlink's own client sees the robot drive, and stops it."""

from typing import Any

import pytest

from ground.gateway.dialect import mavlink
from tests.support.stack.mavlink_client import LOCAL, MavlinkClient, free_port
from tests.support.stack.processes import Crew

pytestmark = pytest.mark.stack


def is_driving(heartbeat: Any) -> bool:
    armed = heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    return bool(armed) and heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


def test_client_of_up_sees_the_drive_and_stops_it() -> None:
    port = free_port()
    with Crew() as crew:
        up = crew.start("up", "--headless", "--mavlink", f"udpin:{LOCAL}:{port}")
        client = MavlinkClient(port)
        client.next("HEARTBEAT", is_driving)
        first = client.next("GLOBAL_POSITION_INT")
        client.next("GLOBAL_POSITION_INT", lambda one: one.lon != first.lon)
        assert client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0) == 0
        client.link.close()
        assert up.ends() == 1
        assert "emergency stop" in up.said
        assert "Traceback" not in up.said, up.said
