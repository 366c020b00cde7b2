"""Latency from a published sensor sample to the wheel command, compared with a Zenoh ping-pong.

A substitute plant publishes wheel ticks, scan and truth 20 times a second to the real robot
process. The latency counts from before the first put to the arrival of the command that answers
them. Half a period later follows a ping with frames of the same sizes, so that both run under the
same load. Both are also shown back to back, where no process sleeps, without a threshold. There,
ours runs in lockstep, with the clock's frame and the telemetry of every tick on the same link.
"""

import argparse

from checks.harness.figures import BenchmarkReport, Figure, percentile
from checks.harness.processes import robot_process
from checks.harness.stand_in import PlantStandIn, driving, paced, wait_until
from checks.speed.pingpong import PingPong, ping_pong
from plant.world.file import load
from protocol.wire.codec import Encoder
from protocol.wire.messages import SonarScan, WheelCommand
from protocol.world import World
from runtime.units import PERIOD_NS

P50_AT_MOST, P99_AT_MOST = 2.0, 3.0
WARM_UP = 40
BUSY = 2000


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--blocks", type=int, default=6)
    parser.add_argument("--ticks", type=int, default=200, help="in each block")
    parser.add_argument("--realtime", action="store_true", help="run the robot with SCHED_FIFO")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Measure latency and ping-pong in turn, and both back to back."""
    world = load(options.world)
    flags = ["--realtime"] if options.realtime else []
    with (
        robot_process(world, *flags) as robot,
        ping_pong(*sizes()) as pings,
        driving(world, robot, lockstep=False) as standin,
    ):
        in_turn(standin, pings, WARM_UP)
        blocks = [in_turn(standin, pings, options.ticks) for _ in range(options.blocks)]
        busy_us = [trip_us(pings) for _ in range(BUSY)]
        lockstep_us = in_lockstep(world, BUSY)
    figures = [
        *figures_of("p50", 0.5, blocks, P50_AT_MOST),
        *figures_of("p99", 0.99, blocks, P99_AT_MOST),
    ]
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        bare_us, ours_us = percentile(busy_us, share), percentile(lockstep_us, share)
        figures += [
            Figure(
                name=f"ours / floor back to back, {name}", unit="x", values=(ours_us / bare_us,)
            ),
            Figure(name=f"sense to command back to back, {name}", unit="us", values=(ours_us,)),
            Figure(name=f"floor back to back, {name}", unit="us", values=(bare_us,)),
        ]
    lost = sum(options.ticks - len(ours) for ours, _ in blocks)
    notes = (
        f"{options.blocks} blocks of {options.ticks} ticks at 20 Hz; {lost} commands not in time",
        "ours includes samples, decoding, core and encoding; the floor only passes bytes",
        *(line for line in robot.output if "warning" in line),
    )
    return BenchmarkReport(benchmark="latency", figures=tuple(figures), notes=notes)


def in_lockstep(world: World, ticks: int) -> list[float]:
    """Return the times in us from samples to command in lockstep."""
    with (
        robot_process(world, "--lockstep") as robot,
        driving(world, robot, lockstep=True) as standin,
    ):
        return [took_ns / 1e3 for _ in range(ticks) if (took_ns := standin.tick()) is not None]


def in_turn(standin: PlantStandIn, pings: PingPong, ticks: int) -> tuple[list[float], list[float]]:
    """Return the times in us of ours and of the ping-pong, half a period apart."""
    ours: list[float] = []
    floors: list[float] = []
    for due_ns in paced(ticks):
        took_ns = standin.tick()
        if took_ns is not None:
            ours.append(took_ns / 1e3)
        wait_until(due_ns + PERIOD_NS // 2)
        floors.append(trip_us(pings))
    return ours, floors


def trip_us(pings: PingPong) -> float:
    """Return one round trip of the ping-pong in us; raise RuntimeError without a reply."""
    took_ns = pings.round_trip_ns()
    if took_ns is None:
        raise RuntimeError("no reply to a ping")
    return took_ns / 1e3


def figures_of(
    name: str, share: float, blocks: list[tuple[list[float], list[float]]], at_most: float
) -> list[Figure]:
    """Return the figures of one quantile."""
    ours = tuple(percentile(block[0], share) for block in blocks)
    floors = tuple(percentile(block[1], share) for block in blocks)
    ratios = tuple(a / b for a, b in zip(ours, floors, strict=True))
    return [
        Figure(name=f"ours / floor, {name}", unit="x", values=ratios, at_most=at_most),
        Figure(name=f"sense to command, {name}", unit="us", values=ours),
        Figure(name=f"floor at 20 Hz, {name}", unit="us", values=floors),
    ]


def sizes() -> tuple[int, int]:
    """Return the sizes of a scan and of a wheel command on the wire in bytes."""
    encoder = Encoder(1, 1)
    stamp_ns = 123_450_000_000
    scan = SonarScan(
        time_ns=stamp_ns,
        seq=2469,
        range_mm=(412,) * 8,
        ping_age_us=(25_000, 0) * 4,
        valid=255,
        echo=255,
    )
    command = WheelCommand(
        time_ns=stamp_ns,
        seq=2468,
        sense_seq=2469,
        left_mrad_s=8123,
        right_mrad_s=7544,
        ttl_ms=150,
    )
    return len(encoder.encode(scan)), len(encoder.encode(command))
