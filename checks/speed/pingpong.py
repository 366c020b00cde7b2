"""The lower bound of latency: a bare Zenoh ping-pong of two processes without codec or loop.

The child is the hub that replies (`python -m checks.speed.pingpong PORT BYTES`), the parent the
client that sends. Both use direct callbacks and the flow settings of the stack.
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event
from typing import Any

import zenoh
from zenoh.handlers import Callback

from checks.harness.processes import free_port

PING, PONG = "floor/ping", "floor/pong"
ANSWER_WITHIN_S = 2.0
MATCH_WITHIN_S = 5.0


class PingPong:
    """Round trips of one payload size."""

    def __init__(self, session: zenoh.Session, size: int) -> None:
        self._payload = bytes(size)
        self._arrived_ns = 0
        self._arrived = Event()
        self._subscriber = session.declare_subscriber(PONG, Callback(self._receive, indirect=False))
        self._ping = flow(session, PING)
        await_matched(self._ping)

    def round_trip_ns(self) -> int | None:
        """Return the time from before the put to the reply; None without a reply."""
        self._arrived.clear()
        asked_ns = time.monotonic_ns()
        self._ping.put(self._payload)
        if not self._arrived.wait(ANSWER_WITHIN_S):
            return None
        return self._arrived_ns - asked_ns

    def _receive(self, _: zenoh.Sample) -> None:
        self._arrived_ns = time.monotonic_ns()
        self._arrived.set()


@contextmanager
def ping_pong(ping_bytes: int, pong_bytes: int) -> Iterator[PingPong]:
    """Start the replying process and yield the ping-pong."""
    port = free_port()
    command = [sys.executable, "-m", "checks.speed.pingpong", str(port), str(pong_bytes)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        try:
            child.stdout.readline()  # wait until it listens
            with zenoh.open(configured("client", connect=f"tcp/127.0.0.1:{port}")) as session:
                yield PingPong(session, ping_bytes)
        finally:
            child.kill()


def answer_pings(port: int, size: int) -> None:
    """Reply to pings until standard input is closed."""
    with zenoh.open(configured("peer", listen=f"tcp/127.0.0.1:{port}")) as session:
        pong, payload = flow(session, PONG), bytes(size)
        answering: Callback[zenoh.Sample] = Callback(lambda _: pong.put(payload), indirect=False)
        with session.declare_subscriber(PING, answering):
            print("listening", flush=True)
            sys.stdin.read()


def flow(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """Declare a publisher with the flow settings of the stack."""
    return session.declare_publisher(
        key,
        priority=zenoh.Priority.REAL_TIME,
        congestion_control=zenoh.CongestionControl.DROP,
        express=False,
    )


def await_matched(publisher: zenoh.Publisher) -> None:
    """Wait until a subscriber is found; raise RuntimeError otherwise."""
    matched = Event()
    noticing: Callback[zenoh.MatchingStatus] = Callback(
        lambda status: matched.set() if status.matching else None, indirect=False
    )
    with publisher.declare_matching_listener(noticing):
        status: Any = publisher.matching_status  # always truthy, unlike its stub
        if not (status.matching or matched.wait(MATCH_WITHIN_S)):
            raise RuntimeError("the two processes of the ping-pong did not connect")


def configured(mode: str, listen: str | None = None, connect: str | None = None) -> zenoh.Config:
    """Return the configuration of a session."""
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


if __name__ == "__main__":
    answer_pings(int(sys.argv[1]), int(sys.argv[2]))
