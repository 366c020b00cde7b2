"""The robot process at 20 Hz with a subscribed ground: CPU share, memory, import time, growth.

CPU and memory are the kernel's figures of the process. Growth is measured in lockstep, where ten
simulated hours take minutes: `--hours 10`.
"""

import argparse
import subprocess
import sys
from time import monotonic

from checks.harness.figures import Figure, Report
from checks.harness.processes import cpu_s, resident_mb, robot_process
from checks.harness.stand_in import PlantStandIn, driving, paced
from plant.world.file import load
from protocol.bus.bus import open_bus
from protocol.world import World
from runtime.units import CONTROL_HZ

CPU_AT_MOST, RSS_AT_MOST, IMPORT_AT_MOST, GROWTH_AT_MOST = 5.0, 60.0, 0.3, 1.0
IMPORTING = "import time; t = time.perf_counter(); import robot.run; print(time.perf_counter() - t)"
TICKS_PER_HOUR = round(3600 * CONTROL_HZ)
SAMPLES = 40
LOCKSTEP_PATIENCE_S = 5.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--seconds", type=float, default=15.0, help="per repetition, at 20 Hz")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--hours", type=float, default=1.0, help="simulated, for growth; 0: none")


def measure(options: argparse.Namespace) -> Report:
    """Measure import time, CPU, memory and growth."""
    world = load(options.world)
    figures = [
        Figure(
            name="imports, fresh process",
            unit="s",
            values=tuple(import_s() for _ in range(7)),
            at_most=IMPORT_AT_MOST,
        ),
        *in_wall_time(world, options.seconds, options.repetitions),
    ]
    notes = ["a ground subscribes to all topics of the robot"]
    if options.hours > 0:
        growth, note = over_hours(world, options.hours)
        figures.append(growth)
        notes.append(note)
    return Report(benchmark="robot", figures=tuple(figures), notes=tuple(notes))


def import_s() -> float:
    """Return the time to import the robot in a new process."""
    done = subprocess.run(
        [sys.executable, "-c", IMPORTING], capture_output=True, check=True, text=True
    )
    return float(done.stdout)


def in_wall_time(world: World, seconds: float, repetitions: int) -> list[Figure]:
    """Measure CPU and memory at wall-clock speed."""
    shares: list[float] = []
    sizes: list[float] = []
    with (
        robot_process(world) as robot,
        open_bus(robot.network, None, "ground") as ground,
        driving(world, robot, lockstep=False) as standin,
    ):
        ground.stream_all(lambda _key, _frame, _ns: None)
        for _ in range(repetitions):
            shares.append(busy_percent(standin, robot.pid, seconds))
            sizes.append(resident_mb(robot.pid))
    return [
        Figure(
            name="CPU of one core at 20 Hz", unit="%", values=tuple(shares), at_most=CPU_AT_MOST
        ),
        Figure(name="resident", unit="MB", values=tuple(sizes), at_most=RSS_AT_MOST),
    ]


def busy_percent(standin: PlantStandIn, pid: int, seconds: float) -> float:
    """Return the CPU share of a process while it drives."""
    begun_s, begun_cpu_s = monotonic(), cpu_s(pid)
    for _ in paced(round(seconds * CONTROL_HZ)):
        standin.tick()
    return 100.0 * (cpu_s(pid) - begun_cpu_s) / (monotonic() - begun_s)


def over_hours(world: World, hours: float) -> tuple[Figure, str]:
    """Return the growth of resident memory after the first tenth, which fills all buffers."""
    with (
        robot_process(world, "--lockstep") as robot,
        driving(world, robot, lockstep=True) as standin,
    ):
        sizes = []
        begun_s = monotonic()
        for _ in range(SAMPLES):
            for _ in range(round(hours * TICKS_PER_HOUR / SAMPLES)):
                if standin.tick(LOCKSTEP_PATIENCE_S) is None:
                    raise RuntimeError("the robot did not answer in lockstep")
            sizes.append(resident_mb(robot.pid))
        pace = hours * 3600 / (monotonic() - begun_s)
    growth = Figure(
        name=f"growth over {hours:g} simulated h",
        unit="MB",
        values=(sizes[-1] - sizes[SAMPLES // 10],),
        at_most=GROWTH_AT_MOST,
    )
    shown = ", ".join(f"{size:.1f}" for size in sizes[:: SAMPLES // 10])
    return growth, f"resident at each tenth, MB: {shown}; {pace:.0f} x real time"
