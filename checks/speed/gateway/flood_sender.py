"""A sender of many frames: `python -m checks.speed.gateway.flood_sender KIND RATE PEERS PORT`.

It is a process that prints `ready`, begins at the first line of its standard input,
and prints how many frames it has sent when its input ends.
"""

import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import cycle
from random import Random
from typing import Any, Final, Self

from checks.flood.attackers import BURST_S
from checks.speed.gateway.forgery import NoFile, command, commands
from gateways.mavlink.mavlink_dialect import mavlink
from runtime.clock import WallClock
from runtime.units import NS_PER_S

TURN_NS: Final = NS_PER_S // 200
MIXED: Final = "mixed"
SUPPLY: Final = 500
SYSTEM: Final = 200
NOBODY: Final = 55_555
"""The id of a message that no dialect has."""


def packed(messages: Sequence[Any]) -> Iterator[bytes]:
    """Yield the frames of messages again and again, with rising sequence numbers."""
    encoder = mavlink.MAVLink(NoFile(), SYSTEM, 190)
    for message in cycle(messages):
        encoder.seq = (encoder.seq + 1) & 0xFF
        yield bytes(message.pack(encoder))


def valid(random: Random) -> Iterator[bytes]:
    """Yield requests that a gateway answers, and commands that it has to refuse."""
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    reads = [mavlink.MAVLink_param_request_read_message(1, 1, b"", n) for n in range(20)]
    asks = [
        mavlink.MAVLink_param_request_list_message(1, 1),
        mavlink.MAVLink_mission_request_list_message(1, 1),
        mavlink.MAVLink_timesync_message(0, 1),
        mavlink.MAVLink_ping_message(1, 1, 1, 1),
        command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    ]
    stops = (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    orders = [  # an emergency stop is open to all: it would end the drive
        one for one in commands((0, 0)) if getattr(one, "command", 0) not in stops
    ]
    moves = [one for one in orders if one.get_type() != "SETUP_SIGNING" and not is_hold(one)]
    return packed([beat, *reads, *asks, *moves])


def is_hold(message: Any) -> bool:
    """Return whether a message only stops the robot, which is open to all."""
    return getattr(message, "param2", None) == 4.0 or getattr(message, "custom_mode", None) == 4


def broken(random: Random) -> Iterator[bytes]:
    """Yield frames with a wrong byte, cut frames, and noise that begins like a frame."""
    for frame in valid(random):
        data, way = bytearray(frame), random.randrange(3)
        if way == 0:
            data[random.randrange(1, len(data))] ^= 1 + random.randrange(255)
        elif way == 1:
            del data[random.randrange(1, len(data)) :]
        else:
            data = bytearray((mavlink.PROTOCOL_MARKER_V2,)) + random.randbytes(60)
        yield bytes(data)


def unknown(random: Random) -> Iterator[bytes]:
    """Yield frames of messages that no dialect has."""
    for frame in valid(random):
        data = bytearray(frame)
        data[7:10] = (NOBODY + random.randrange(1000)).to_bytes(3, "little")
        yield bytes(data)


KINDS: Final[Mapping[str, Callable[[Random], Iterator[bytes]]]] = {
    "valid": valid,
    "broken": broken,
    "unknown": unknown,
}


def supply_of(kind: str) -> list[bytes]:
    """Return frames of a kind, or of all kinds in turn."""
    random = Random(1)
    chosen = [KINDS[kind]] if kind != MIXED else list(KINDS.values())
    sources = [make(random) for make in chosen]
    return [next(source) for _ in range(SUPPLY) for source in sources]


class FrameFlood:
    """A running sender, at a lower priority: a real one would use another machine."""

    def __init__(self, kind: str, rate_hz: float, peers: int, port: int) -> None:
        arguments = (kind, str(rate_hz), str(peers), str(port))
        self.sent = 0
        self._child = subprocess.Popen(
            ["nice", sys.executable, "-m", "checks.speed.gateway.flood_sender", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._child.stdout is not None
        if "ready" not in self._child.stdout.readline():
            raise RuntimeError(f"no sender of {kind} frames")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        output, _errors = self._child.communicate("", timeout=20.0)
        self.sent = int(output)

    def go(self) -> None:
        """Begin."""
        assert self._child.stdin is not None
        self._child.stdin.write("go\n")
        self._child.stdin.flush()


def send(frames: Sequence[bytes], rate_hz: float, peers: int, port: int, over: list[bool]) -> int:
    """Send at a rate, from so many sockets in turn, until it is over; return how many."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(peers)]
    for one in sockets:
        one.connect(("127.0.0.1", port))
        one.setblocking(False)
    pairs = zip(cycle(frames), cycle(sockets), strict=False)
    clock, sent, total = WallClock(), 0, 0
    begun_ns = clock.now_ns()
    while not over:
        due = round((clock.now_ns() - begun_ns) / NS_PER_S * rate_hz)
        for _ in range(min(due - sent, round(rate_hz * BURST_S))):
            frame, one = next(pairs)
            with suppress(OSError):
                one.send(frame)
            total += 1
        sent = due
        clock.sleep_until(clock.now_ns() + TURN_NS)
    return total


def main(kind: str, rate_hz: float, peers: int, port: int) -> None:
    """Send after the first line of standard input, until it ends."""
    frames, over = supply_of(kind), list[bool]()
    print("ready", flush=True)
    if not sys.stdin.readline():
        print(0)
        return

    def wait() -> None:
        sys.stdin.read()
        over.append(True)

    threading.Thread(target=wait, daemon=True).start()
    print(send(frames, rate_hz, peers, port, over), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
