"""Speed of a trial, of its step and of its compiled modules, compared with ir-sim.

ir-sim runs without controller in its own virtual environment. It gets the same world, robot, forty
rays to 3 m and 50 ms step, and drives in a small circle at the robot's start. The two take turns.

A step of the control core is replayed over a recorded drive through a forest. The garbage collector
stays enabled after `gc.freeze()`, as on the robot. The cost of reading the clock is included and
reported. Each repetition replays the same inputs from the start; a longer drive repeats the
recorded one.

Compiled modules and pure Python take turns in each world, so that a load on the machine slows all.
The compiled installation is built first. With `--before` an older checkout takes part, for the
table of stages.
"""

import argparse
import gc
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from math import pi
from pathlib import Path
from statistics import median
from time import process_time, thread_time_ns
from typing import Any, Final

from checks.built import ROOT, install_compiled
from checks.harness.figures import (
    BenchmarkFunctions,
    BenchmarkReport,
    Figure,
    digits,
    figure,
    percentile,
    ratios,
)
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.navigators import NAVIGATORS, USUAL_NAVIGATOR
from protocol.ring import RADIUS_M
from protocol.wire.messages import SonarScan, WheelTicks
from protocol.world import Obstacle, World, WorldCircle, WorldPolygon
from robot.core import brain, modes, states
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Goal, Inputs, Outputs, Pose, goal_of, now_ms_of, scan_of, wheels_of
from runtime.units import PERIOD_S
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial, start_of, wire_goal_of

REQUIREMENT = "ir-sim>=2.10"
DRIVER = Path(__file__).with_name("irsim_driver.py")
RAYS = 40


Ask = Callable[[object], Any]
"""What asks a child: a line, which it answers with a line of JSON."""


@contextmanager
def json_child(words: Sequence[str | Path], **settings: Any) -> Iterator[Ask]:
    """Run a program that answers each line with JSON; other lines of it are skipped."""
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **settings
    ) as child:

        def ask(line: object) -> Any:
            assert child.stdin is not None
            assert child.stdout is not None
            child.stdin.write(f"{line}\n")
            child.stdin.flush()
            for answer in child.stdout:
                if answer.startswith("{"):
                    return json.loads(answer)
            raise RuntimeError(f"{words[-1]} ended without a reply")

        try:
            yield ask
        finally:
            child.kill()


class IrSim:
    """A child process that steps the world."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        greeting = ask(0)
        self.version: str = greeting["version"]
        if greeting["rays"] != RAYS:
            raise RuntimeError(f"ir-sim casts {greeting['rays']} rays instead of {RAYS}")

    def run(self, steps: int) -> tuple[float, float]:
        """Run the steps; return CPU and wall time in s."""
        answer = self._ask(steps)
        return answer["cpu_s"], answer["wall_s"]


@contextmanager
def running_irsim(world: World, venv: Path) -> Iterator[IrSim]:
    """Start ir-sim with this world."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(json.dumps(scene_of(world)), encoding="utf-8")  # JSON is YAML
        settings = {"stderr": subprocess.DEVNULL, "env": {**os.environ, "MPLBACKEND": "Agg"}}
        with json_child([prepared(venv), "-P", DRIVER, path], **settings) as ask:
            yield IrSim(ask)


def prepared(venv: Path) -> Path:
    """Return the Python of the virtual environment, which is made on first use."""
    python = venv / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    have = subprocess.run([python, "-c", "import irsim"], capture_output=True, check=False)
    if have.returncode != 0:
        print(f"installing {REQUIREMENT} in {venv}", file=sys.stderr)
        subprocess.run([python, "-m", "pip", "install", "-q", REQUIREMENT], check=True)
    return python


def scene_of(world: World) -> dict[str, Any]:
    """Return the world in ir-sim's format; raise ValueError for what ir-sim cannot represent."""
    width_m, height_m = world.size_m
    obstacles = [_obstacle(obstacle) for obstacle in world.obstacles]
    if world.walls:
        corners = [[0, 0], [width_m, 0], [width_m, height_m], [0, height_m], [0, 0]]
        obstacles.append({"shape": {"name": "linestring", "vertices": corners}})
    return {
        "world": {
            "width": width_m,
            "height": height_m,
            "step_time": PERIOD_S,
            "sample_time": PERIOD_S,
        },
        "robot": [_robot(world)],
        "obstacle": obstacles,
    }


def _robot(world: World) -> dict[str, Any]:
    start, goal = world.start, world.goal
    lidar = {
        "name": "lidar2d",
        "range_min": 0.02,
        "range_max": 3.0,
        "angle_range": pi,
        "number": RAYS,
    }
    return {
        "kinematics": {"name": "diff"},
        "shape": {"name": "circle", "radius": RADIUS_M},
        "state": [start.x_m, start.y_m, start.heading_rad],
        "goal": [goal.x_m, goal.y_m, goal.heading_rad or 0.0],
        "vel_max": [0.3, 2.5],
        "sensors": [lidar],
    }


def _obstacle(obstacle: Obstacle) -> dict[str, Any]:
    if isinstance(obstacle, WorldCircle):
        shape: dict[str, Any] = {"name": "circle", "radius": obstacle.radius_m}
        return {"shape": shape, "state": [obstacle.x_m, obstacle.y_m, 0.0]}
    if isinstance(obstacle, WorldPolygon):
        return {"shape": {"name": "polygon", "vertices": [list(p) for p in obstacle.points_m]}}
    return {"shape": {"name": "linestring", "vertices": [list(p) for p in obstacle.points_m]}}


AT_LEAST = 400.0
AT_MOST_US = 125.0
PEER_STEPS = 150
WORLDS = ("forest_medium", "forest_dense")


def add_trial_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS))
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument("--no-peer", action="store_true", help="measure without ir-sim")
    parser.add_argument(
        "--venv",
        type=Path,
        default=Path(".bench-venv"),
        help="virtual environment of ir-sim",
    )


def measure_trials(options: argparse.Namespace) -> BenchmarkReport:
    """Measure trials and ir-sim in each world."""
    figures: list[Figure] = []
    notes: list[str] = []
    for name in options.worlds:
        world = load(name)
        if options.no_peer:
            pairs = [(*time_trial(world), 0.0) for _ in range(options.repetitions)]
        else:
            with running_irsim(world, options.venv) as peer:
                pairs = list(trial_paces_in_turn(world, peer, options.repetitions))
                notes.append(f"{name}: {len(world.obstacles)} obstacles; ir-sim {peer.version}")
        figures += trial_figures(name, pairs)
    return BenchmarkReport(benchmark="trial", figures=tuple(figures), notes=tuple(notes))


def trial_paces_in_turn(
    world: World, peer: IrSim, repetitions: int
) -> Iterator[tuple[float, float, float]]:
    """Yield pace and cost of a trial and the pace of ir-sim, in turn."""
    for _ in range(repetitions):
        _, peer_wall_s = peer.run(PEER_STEPS)
        yield *time_trial(world), PEER_STEPS * PERIOD_S / peer_wall_s


def time_trial(world: World) -> tuple[float, float]:
    """Return pace (x real time, drive loop) and CPU time in us per tick, set-up included."""
    begun_s = process_time()
    outcome = run_trial(Trial(world=world))
    spent_s = process_time() - begun_s
    return outcome.time_s / outcome.wall_s, spent_s * 1e6 / outcome.ticks


def trial_figures(name: str, pairs: list[tuple[float, float, float]]) -> Iterator[Figure]:
    """Yield the figures of one world."""
    ours, costs, peers = (list(column) for column in zip(*pairs, strict=True))
    yield figure(f"{name}, real time", ours, "x", at_least=AT_LEAST)
    yield figure(f"{name}, CPU with set-up", costs, "us/tick", at_most=AT_MOST_US)
    if all(peers):
        yield figure(f"{name}, ir-sim real time", peers, "x")
        yield figure(f"{name}, ours / ir-sim", ratios(ours, peers), "x")


MEDIAN_US, WORST_US = 60.0, 200.0
STEPS = 10_000


def add_step_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--navigator", choices=NAVIGATORS, default=USUAL_NAVIGATOR)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--repetitions", type=int, default=5)


def measure_steps(options: argparse.Namespace) -> BenchmarkReport:
    """Measure the steps of a recorded drive."""
    world = load(options.world)
    inputs = recorded(Trial(world=world, navigator=options.navigator))
    start, goal = start_of(world), goal_of(*wire_goal_of(world))
    navigator = NAVIGATORS[options.navigator]
    gc.freeze()
    try:
        runs = [
            costs_us(inputs, start, goal, navigator, options.steps)
            for _ in range(options.repetitions)
        ]
    finally:
        gc.unfreeze()
    shares = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "worst": 1.0}
    limits = {"median": MEDIAN_US, "worst": WORST_US}
    figures = [
        figure(
            f"brain.step, {name} of {options.steps}",
            [percentile(run, share) for run in runs],
            "us",
            at_most=limits.get(name),
        )
        for name, share in shares.items()
    ]
    notes = (
        f"{options.world}, {options.navigator}: {len(inputs)} recorded ticks, repeated",
        "CPU time of the thread; garbage collector on after gc.freeze(), as on the robot",
        f"reading the clock costs {percentile(idle_us(), 0.5):.2f} us of each",
    )
    return BenchmarkReport(benchmark="core", figures=tuple(figures), notes=notes)


def recorded(trial: Trial) -> list[Inputs]:
    """Return the inputs of the core, tick by tick, from the tick of the goal on."""
    inputs: list[Inputs] = []

    def watch(plant: Plant, _onboard: CoreLoop, _outputs: Outputs) -> None:
        wheels, scan = plant.senses()
        inputs.append(given(plant.now_ns, wheels, scan))

    run_trial(trial, watch)
    return inputs


def given(now_ns: int, wheels: WheelTicks | None, scan: SonarScan | None) -> Inputs:
    """Return the inputs of one tick."""
    return Inputs(
        now_ms_of(now_ns),
        None if wheels is None else wheels_of(wheels),
        None if scan is None else scan_of(scan, 0),
        None,
    )


def costs_us(
    inputs: list[Inputs], start: Pose, goal: Goal, navigator: int, steps: int
) -> list[float]:
    """Return the CPU time in us of this many steps."""
    costs: list[float] = []
    while len(costs) < steps:
        costs += drive_us(inputs, start, goal, navigator)
    return costs[:steps]


def drive_us(inputs: list[Inputs], start: Pose, goal: Goal, navigator: int) -> list[float]:
    """Return the CPU times of one drive without its last tick, which ends the goal."""
    state, params = begun_drive(inputs[0], start, goal, navigator)
    costs: list[float] = []
    for one in inputs[1:-1]:
        begun_ns = thread_time_ns()
        brain.step(state, one, params)
        costs.append((thread_time_ns() - begun_ns) / 1e3)
    return costs


def begun_drive(
    first: Inputs, start: Pose, goal: Goal, navigator: int
) -> tuple[brain.State, Params]:
    """Return the state of the core after its first step, with the goal, and its parameters."""
    params = DEFAULTS._replace(navigator=navigator)
    state = brain.State(params)
    state.odometry.pose = start
    brain.step(state, first, params)
    modes.arm(state.machine)
    modes.goto(state.machine, goal, states.AUTO, first.now_ms)
    return state, params


def idle_us() -> list[float]:
    """Return the CPU times of reading the clock."""
    costs: list[float] = []
    for _ in range(1000):
        begun_ns = thread_time_ns()
        costs.append((thread_time_ns() - begun_ns) / 1e3)
    return costs


STAGES: Final = Path(__file__).with_name("stages.py")
LIMITS: Final = {"compiled": (2000.0, 25.0), "pure": (600.0, 8.0)}
"""Least pace, and least ratio to ir-sim."""

Measured = dict[str, list[Any]]
"""Replies of each child, by its name."""


def running_stages(folder: Path) -> AbstractContextManager[Ask]:
    """Start a child that measures trials with the packages of a folder."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    return json_child([sys.executable, "-P", STAGES], cwd=folder, env=environment)


def add_compiled_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=["forest_medium", "forest_dense"])
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--before", type=Path, help="an older checkout to compare with")
    parser.add_argument("--no-peer", action="store_true", help="measure without ir-sim")
    parser.add_argument("--venv", type=Path, default=Path(".bench-venv"))
    parser.add_argument("--page", type=Path, help="write the table of stages to this file")


def measure_compiled(options: argparse.Namespace) -> BenchmarkReport:
    """Measure each world."""
    figures: list[Figure] = []
    tables: list[str] = []
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        folders = {"compiled": install_compiled(Path(folder) / "installation"), "pure": ROOT}
        if options.before:
            folders["before"] = options.before.resolve()
        children = {name: stack.enter_context(running_stages(at)) for name, at in folders.items()}
        for world in options.worlds:
            found = stages_in_turn(world, children, options)
            assert found["compiled"][0]["compiled"]
            figures += compiled_figures(world, found)
            tables.append(table(world, found))
    if options.page:
        options.page.write_text(page(tables, figures, options.before), encoding="utf-8")
    return BenchmarkReport(benchmark="compiled", figures=tuple(figures))


def stages_in_turn(
    world: str, children: Mapping[str, Ask], options: argparse.Namespace
) -> Measured:
    """Measure a world with every child, and ir-sim's pace, some times in turn."""
    found: Measured = {name: [] for name in (*children, "ir-sim")}
    with ExitStack() as stack:
        peer = None
        if not options.no_peer:
            peer = stack.enter_context(running_irsim(load(world), options.venv))
        for _ in range(options.repetitions):
            for name, child in children.items():
                found[name].append(child(world))
            if peer is not None:
                cpu_s, _ = peer.run(PEER_STEPS)
                found["ir-sim"].append(PEER_STEPS * PERIOD_S / cpu_s)
    return found


def compiled_figures(world: str, found: Measured) -> Iterator[Figure]:
    """Yield pace and ratios of a world; ratios are those of neighbours in time."""
    paces = {name: [one["pace"] for one in found[name]] for name in found if name != "ir-sim"}
    for name, (least, least_ratio) in LIMITS.items():
        yield figure(f"{world}, {name}", paces[name], "x", at_least=least)
        if found["ir-sim"]:
            over = ratios(paces[name], found["ir-sim"])
            title = f"{world}, {name} / ir-sim"
            yield figure(title, over, "x", at_least=least_ratio)
    over = ratios(paces["compiled"], paces["pure"])
    yield figure(f"{world}, compiled / pure", over, "x")
    same = float(len({one["digest"] for name in LIMITS for one in found[name]}) == 1)
    yield figure(f"{world}, equal digests", same, at_least=1.0)


def table(world: str, found: Measured) -> str:
    """Return the cost of each stage as a table in Markdown."""
    names = [name for name in ("before", "pure", "compiled") if name in found]
    lines = [f"## {world}", "", "| stage | " + " | ".join(f"{name}, us" for name in names) + " |"]
    lines.append("|---|" + "---|" * len(names))
    for stage in found["pure"][0]["stages_us"]:
        costs = [median(one["stages_us"][stage] for one in found[name]) for name in names]
        lines.append(f"| {stage} | " + " | ".join(f"{cost:.1f}" for cost in costs) + " |")
    whole = [median(one["whole_us"] for one in found[name]) for name in names]
    lines.append("| whole trial | " + " | ".join(f"{cost:.1f}" for cost in whole) + " |")
    return "\n".join(lines)


def commit_of(folder: Path) -> str:
    """Return the commit that is checked out in a folder."""
    words = ("git", "-C", str(folder), "describe", "--always", "--dirty")
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()


def page(tables: Sequence[str], figures: Sequence[Figure], before: Path | None = None) -> str:
    """Return the page of evidence; `before` is the older checkout."""
    older = f"commit `{commit_of(before)}`" if before else "an older commit"
    head = (
        "# Compiled modules\n\n"
        "Made by `sidestep bench compiled --page docs/evidence/compiled.md`. CPU time of one"
        " control period, medians.\n*pure* is this commit in pure Python, *compiled* the same"
        f" sources compiled with mypyc, *before* {older}.\nA stage is measured alone, along"
        " the path of a recorded trial; *rest* is the difference to the whole trial\nwith its"
        " set-up. The machine was shared: rely on ratios."
    )
    rows = ["| figure | median | spread | at least |", "|---|---|---|---|"]
    for one in figures:
        spread = f"{digits(min(one.values))} to {digits(max(one.values))}"
        least = "" if one.at_least is None else f"{one.at_least:g}"
        rows.append(f"| {one.name} | {digits(one.median)} {one.unit} | {spread} | {least} |")
    return "\n\n".join([head, "\n".join(rows), *tables]) + "\n"


TRIAL = BenchmarkFunctions(add_trial_options, measure_trials)
COMPILED = BenchmarkFunctions(add_compiled_options, measure_compiled)
STEP = BenchmarkFunctions(add_step_options, measure_steps)
