"""What ground stations send, as read in their sources, in simulated time.

Each script in `tests/interop/shaped` is played from its connection to the emergency stop, on a line
that loses nothing. `make interop` plays the same scripts in real time, also on a lossy line. The
reading of a file is left out: pymavlink's client has a clock of its own, and tests of its own.
"""

import tomllib
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as all_dialects

from checks.harness.in_process import InProcess
from gateways.mavlink.mavlink_dialect import mavlink
from tests.closed_loop.test_gateway import Gateway, stack_with_gateway
from tests.interop.clients import pilot, shaped_client, steps
from tests.interop.clients.pilot import GROUND_STATION, Station
from tests.interop.clients.shaped_client import SCRIPTS, Script
from tests.interop.clients.steps import Call

NAMES = sorted(path.stem for path in SCRIPTS.glob("*.toml"))
LEFT_OUT = "file"
BY_NAME = {one.msgname: one for one in mavlink.mavlink_map.values()}
PUBLISHED = {one.msgname for one in all_dialects.mavlink_map.values()}
"""What pymavlink decodes; the gateway's own dialect has more."""
BEAT_S = 1.0
RECORDING_BYTES = 1_001


class SimulatedStation(Station):
    """A ground station whose frames reach the gateway at once; its time is that of the stack."""

    def __init__(self, stack: InProcess, gateway: Gateway) -> None:
        super().__init__()
        self._stack, self._gateway = stack, gateway
        self._there = mavlink.MAVLink(None, 1, 1)
        self._here = mavlink.MAVLink(None)
        self.mav = mavlink.MAVLink(SimpleNamespace(write=gateway.deliver), *GROUND_STATION)
        self._beat_s = 0.0

    def monotonic(self) -> float:
        """Return the time of the stack."""
        return self._stack.clock.now_ns() / 1e9

    def look(self) -> None:
        """Let a tick pass; send a heartbeat each second."""
        if self.monotonic() - self._beat_s >= BEAT_S:
            self._beat_s = self.monotonic()
            self.mav.heartbeat_send(6, 8, 0, 0, 0)
        for message in self._gateway.tick():
            (received,) = self._here.parse_buffer(message.pack(self._there))
            if received.get_type() not in PUBLISHED:
                received.get_type = partial("UNKNOWN_{}".format, received.get_msgId())
            self.take(received)


@pytest.mark.parametrize("name", NAMES)
def test_gateway_answers_every_sequence_of_a_client(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (read := tmp_path / "read").mkdir()
    recording = tmp_path / "20261123T120000Z-r1.tlog"
    recording.write_bytes(bytes(n * n % 251 for n in range(RECORDING_BYTES)))
    script = tomllib.loads((SCRIPTS / f"{name}.toml").read_text(encoding="utf-8"))
    with stack_with_gateway(tmp_path) as (stack, gateway):
        station: Any = SimulatedStation(stack, gateway)
        for module in (steps, shaped_client):
            monkeypatch.setattr(module, "time", station)
        for module in (pilot, shaped_client):
            monkeypatch.setattr(module, "mavlink", mavlink)
        monkeypatch.setattr(shaped_client, "BY_NAME", BY_NAME)
        run = Script(station, Call("", 0, recording, read), print)
        for step in script["steps"]:
            for action in step["actions"]:
                if action["kind"] != LEFT_OUT:
                    run.run(action)
        assert not station.is_armed
