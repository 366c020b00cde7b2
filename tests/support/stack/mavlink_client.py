"""A MAVLink ground station of a few lines, on pymavlink."""

import socket
import time
from collections.abc import Callable
from typing import Any, Final

from pymavlink import mavutil

from gateways.mavlink.mavlink_dialect import mavlink
from tests.support.until import PATIENCE_S

LOCAL: Final = "127.0.0.1"


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOCAL, 0))
        return int(probe.getsockname()[1])


class MavlinkClient:
    """Sends heartbeats, and waits for messages of system 1."""

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
