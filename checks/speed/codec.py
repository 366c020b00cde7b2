"""Encode and decode every message of a drive with our codec and with pymavlink.

Both start from plain values and end with plain values: encoding includes building the message
object, decoding includes reading the frame into one. Both use fastcrc.
"""

import argparse
from collections.abc import Callable
from time import process_time
from typing import Any

from checks.harness.figures import BenchmarkReport, figure, ratios
from protocol.dialect.generate import oracle
from protocol.wire.codec import Encoder, decode
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    GroundTruth,
    Heartbeat,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    WheelCommand,
    WheelTicks,
)

MIN_RATIO = 3.0
SYSTEM, COMPONENT = 1, 1
NOW_NS = 123_450_000_000


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--repetitions", type=int, default=9)
    parser.add_argument("--rounds", type=int, default=400, help="of all messages, per repetition")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Measure both codecs in turn."""
    samples = sample_messages()
    frames = [Encoder(SYSTEM, COMPONENT).encode(cls(**values)) for cls, values in samples]
    peer = PymavlinkCodec(samples)
    check_equal(frames, peer.encode())
    encoder = Encoder(SYSTEM, COMPONENT)
    jobs: dict[str, Callable[[], object]] = {
        "our encode": lambda: [encoder.encode(cls(**values)) for cls, values in samples],
        "our decode": lambda: [decode(frame) for frame in frames],
        "pymavlink encode": peer.encode,
        "pymavlink decode": lambda: [peer.decode(frame) for frame in frames],
    }
    costs = interleaved(jobs, options.repetitions, options.rounds, len(samples))
    ours = [sum(pair) for pair in zip(costs["our encode"], costs["our decode"], strict=True)]
    theirs = [
        sum(pair) for pair in zip(costs["pymavlink encode"], costs["pymavlink decode"], strict=True)
    ]
    figures = [
        figure("pymavlink / ours, encode + decode", ratios(theirs, ours), "x", at_least=MIN_RATIO)
    ]
    figures += [figure(name, cost, "us") for name, cost in costs.items()]
    crc = "fastcrc" if oracle().mcrf4xx else "pure Python, not comparable: install fastcrc"
    notes = (f"{len(samples)} messages, frames byte-identical; pymavlink's checksum: {crc}",)
    return BenchmarkReport(benchmark="codec", figures=tuple(figures), notes=notes)


class PymavlinkCodec:
    """pymavlink's module, used as documented."""

    def __init__(self, samples: list[tuple[type[Message], dict[str, Any]]]) -> None:
        self._mavlink = oracle().MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._samples = [(self._class_of(cls), values) for cls, values in samples]

    def encode(self) -> list[bytes]:
        """Encode all samples."""
        mavlink = self._mavlink
        return [bytes(cls(**values).pack(mavlink)) for cls, values in self._samples]

    def decode(self, frame: bytes) -> object:
        """Decode one frame."""
        return self._mavlink.decode(bytearray(frame))

    @staticmethod
    def _class_of(cls: type[Message]) -> Any:
        word = "".join(f"_{c.lower()}" if c.isupper() else c for c in cls.__name__)
        return getattr(oracle(), f"MAVLink{word}_message")


def check_equal(ours: list[bytes], theirs: list[bytes]) -> None:
    """Raise RuntimeError unless the frames are equal except for sequence number and checksum."""
    for our, their in zip(ours, theirs, strict=True):
        if our[:4] != their[:4] or our[5:-2] != their[5:-2]:
            raise RuntimeError(f"frames differ: {our.hex()} {their.hex()}")


def interleaved(
    jobs: dict[str, Callable[[], object]], repetitions: int, rounds: int, messages: int
) -> dict[str, list[float]]:
    """Return the CPU time per message in us of each job; the jobs take turns."""
    costs: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repetitions):
        for name, job in jobs.items():
            begun_s = process_time()
            for _ in range(rounds):
                job()
            costs[name].append((process_time() - begun_s) * 1e6 / (rounds * messages))
    return costs


def sample_messages() -> list[tuple[type[Message], dict[str, Any]]]:
    """Return every message of one tick of a drive, with typical values."""
    senses: list[tuple[type[Message], dict[str, Any]]] = [
        (
            SonarScan,
            {
                "time_ns": NOW_NS,
                "seq": 2469,
                "range_mm": (412, 655, 3000, 1234, 987, 0, 1511, 288),
                "ping_age_us": (25_000, 0) * 4,
                "valid": 255,
                "echo": 223,
            },
        ),
        (
            WheelTicks,
            {
                "time_ns": NOW_NS,
                "seq": 2469,
                "left": 18_211,
                "right": -17_090,
                "bumper": 0,
                "expired": 0,
            },
        ),
    ]
    return senses + plant_messages() + telemetry()


def plant_messages() -> list[tuple[type[Message], dict[str, Any]]]:
    """Return the wheel command and the ground truth."""
    stamp = {"time_ns": NOW_NS}
    wheels = {"seq": 2468, "sense_seq": 2469, "left_mrad_s": 8123, "right_mrad_s": 7544}
    truth = {"seq": 2469, "x_m": 3.21, "y_m": 1.72, "heading_rad": 0.41, "speed_m_s": 0.24}
    true_rest = {"yaw_rate_rad_s": -0.11, "clearance_m": 0.288, "contact": 0}
    return [
        (WheelCommand, {**stamp, **wheels, "ttl_ms": 150, "epoch": 0}),
        (GroundTruth, {**stamp, **truth, **true_rest}),
    ]


def telemetry() -> list[tuple[type[Message], dict[str, Any]]]:
    """Return the robot's telemetry."""
    stamp: dict[str, Any] = {"time_ns": NOW_NS}
    where = {"x_m": 3.2, "y_m": 1.7, "heading_rad": 0.4, "speed_m_s": 0.24, "yaw_rate_rad_s": -0.1}
    spread = ("xx_m2", "xy_m2", "xh_m_rad", "yy_m2", "yh_m_rad", "hh_rad2")
    goal = {"goal_x_m": 5.4, "goal_y_m": 2.0, "goal_heading_rad": 0.0, "goal_distance_m": 2.31}
    times = {"goal_started_ns": 50_000_000, "goal_ended_ns": 0}
    ids = {"goal_id": 7_141_592_653, "stop_id": 2_718_281_828}
    state = {"vehicle": 2, "mode": 10, "goal": 3, "vehicle_reason": 0, "goal_reason": 0}
    saw = {"nearest_bearing_rad": 0.59, "nearest_range_m": 0.288, "zone_m": 0.3}
    chose = {"goal_bearing_rad": 0.2, "rotation_rad": -1.18, "virtual_x_m": 4.1, "virtual_y_m": 0.3}
    cost = {"tick": 2469, "missed": 0, "overruns": 0, "rejected": 0, "late_us": 83}
    sample_messages = {"speed_m_s": 0.2, "yaw_rate_rad_s": -0.4, "branch": 3, "guard": 0}
    spent = {"sense_age_us": 25_180, "budget_us": 2500, "stage_us": (31, 12, 20, 6, 240)}
    beat = {"type": 10, "autopilot": 3, "base_mode": 129, "custom_mode": 10}
    return [
        (Heartbeat, beat | {"system_status": 4, "mavlink_version": 3}),
        (PlanarOdometry, stamp | where | {f"cov_{name}": 1.7e-5 for name in spread}),
        (NavigatorStatus, stamp | goal | times | ids | state | {"navigator": 2, "side": 1}),
        (AvoidanceDecision, stamp | saw | chose | sample_messages),
        (CycleReport, stamp | cost | spent),
    ]
