"""`up --mavlink`: pymavlink's own client sees the robot drive, and stops it."""

import socket
import time
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink import mavutil

from ground.gateway.dialect import mavlink
from tests.support.stack.processes import Crew
from tests.support.until import PATIENCE_S

pytestmark = pytest.mark.stack

LOCAL = "127.0.0.1"


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOCAL, 0))
        return int(probe.getsockname()[1])


class Client:
    """A ground station that is heard each second."""

    def __init__(self, port: int) -> None:
        self.link: Any = mavutil.mavlink_connection(f"udpout:{LOCAL}:{port}", source_system=255)

    def next(self, kind: str, accepts: Callable[[Any], bool] = lambda _: True) -> Any:
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4)
            found = self.link.recv_match(type=kind, blocking=True, timeout=1.0)
            if found is not None and accepts(found):
                return found
        raise AssertionError(f"no {kind} within {PATIENCE_S:g} s")

    def command(self, number: int, *params: float) -> int:
        values = (*params, *(0.0,) * (7 - len(params)))
        self.link.mav.command_long_send(1, 1, number, 0, *values)
        return int(self.next("COMMAND_ACK", lambda ack: ack.command == number).result)


def is_driving(heartbeat: Any) -> bool:
    armed = heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    return bool(armed) and heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


def test_client_of_up_sees_the_drive_and_stops_it() -> None:
    port = free_port()
    with Crew() as crew:
        up = crew.start("up", "--headless", "--mavlink", f"udpin:{LOCAL}:{port}")
        client = Client(port)
        client.next("HEARTBEAT", is_driving)
        first = client.next("GLOBAL_POSITION_INT")
        client.next("GLOBAL_POSITION_INT", lambda one: one.lon != first.lon)
        assert client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0) == 0
        client.link.close()
        assert up.ends() == 1
        assert "emergency stop" in up.said
        assert "Traceback" not in up.said, up.said
