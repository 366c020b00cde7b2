"""node-mavlink 2.3: a library for JavaScript that encodes and decodes frames.

A program for Node.js passes messages on as lines of JSON; the steps are those of mavutil's script.
"""

import json
import subprocess
import threading
import time
from collections.abc import Callable
from math import isnan, nan
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

from tests.interop.clients.mavutil_client import run
from tests.interop.clients.pilot import Station, mavlink
from tests.interop.clients.steps import Call, StepError, Steps, called

BRIDGE: Final = Path(__file__).with_name("node_bridge.cjs")
AUTOPILOT: Final = (1, 1)
WAIT_S: Final = 0.05


class Decoded:
    """A message that node-mavlink has decoded."""

    def __init__(self, name: str, system: int, fields: dict[str, Any]) -> None:
        self._name, self._system = name, system
        for key, value in fields.items():
            setattr(self, key, nan if value is None else value)

    def get_type(self) -> str:
        """Return the name of the message, as of pymavlink's messages."""
        return self._name

    def get_srcSystem(self) -> int:  # noqa: N802 - pymavlink's name
        """Return the sender, as of pymavlink's messages."""
        return self._system

    def __str__(self) -> str:
        return f"{self._name} {vars(self)}"


class Encoder(mavlink.MAVLink):  # type: ignore[misc]
    """Writes each message as a line of JSON instead of encoding it."""

    def __init__(self, write: Callable[[str], object]) -> None:
        super().__init__(None)
        self._write = write

    def send(self, mavmsg: Any, force_mavlink1: bool = False) -> None:
        """Write a message."""
        fields = {name: plain(getattr(mavmsg, name)) for name in mavmsg.fieldnames}
        self._write(json.dumps({"name": mavmsg.get_type(), "fields": fields}) + "\n")


def plain(value: Any) -> Any:
    """Return a value of a field as JSON has it."""
    if isinstance(value, bytes):
        return value.rstrip(b"\0").decode()
    return None if isinstance(value, float) and isnan(value) else value


class NodeStation(Station):
    """The process of Node.js."""

    def __init__(self, call: Call) -> None:
        super().__init__()
        words = ["node", str(BRIDGE), call.transport, call.host, str(call.port)]
        self._process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._lines = SimpleQueue[str]()
        self._beat_s = 0.0
        self._sequence: int | None = None
        self.mav = Encoder(self._write)
        threading.Thread(target=self._read, daemon=True).start()

    def look(self) -> None:
        """Receive for a moment; send a heartbeat each second."""
        if self._process.poll() is not None:
            raise StepError(f"Node.js has ended with code {self._process.returncode}")
        if time.monotonic() - self._beat_s >= 1.0:
            self._beat_s = time.monotonic()
            self.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
        try:
            line = self._lines.get(timeout=WAIT_S)
            while True:
                self._decode(json.loads(line))
                line = self._lines.get_nowait()
        except Empty:
            pass

    def _decode(self, found: dict[str, Any]) -> None:
        if (found["system"], found["component"]) == AUTOPILOT:
            sequence = found["sequence"]
            if self._sequence is not None:
                self.lost += (sequence - self._sequence - 1) & 0xFF
            self._sequence = sequence
            self.take(Decoded(found["name"], found["system"], found["fields"]))

    def _write(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line)
        self._process.stdin.flush()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)


def main() -> None:
    """Run the scenario."""
    call, steps = called(), Steps("node-mavlink")
    run(call, steps, lambda: NodeStation(call))


if __name__ == "__main__":
    main()
