"""Describe a run of `up`: its world, its goal, its robots, and the arguments of each process."""

import json
import os
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from ground.client.floor import floor_from, goal_in
from ground.client.goal import Destination, destination
from ground.client.time_factor import chosen_speed
from ground.launch.child_command import command
from ground.launch.recording_session import RECORDER
from ground.launch.supervisor import ROUTER
from ground.launch.tls_configs import locked, with_locks
from protocol.navigators import is_own, name_of
from protocol.outcome import RunSettings, start_arguments
from protocol.world import WorldRun, run_in
from runtime.config import settings_of, totals_arguments
from runtime.errors import RemoteError, UserError
from runtime.units import PERIOD_MS

SHOW_S: Final = 60.0
MAX_SEPARATE: Final = 8
"""Robots that each have a process of their own by default; more are divided among few, because a
process takes nearly as much of a tick as a robot."""

ROBOT_TICK_MS: Final = 1.0
"""Processor time that one of many robots takes of a tick, in all processes: `bench fleet`."""

MAX_RECORDED: Final = 20
PLANT: Final = "plant"
GATEWAY_ROLE: Final = "gateway"
ROS2_ROLE: Final = "ros2"
PACED: Final = "paced"
WALL: Final = "wall"
CLOCKS: Final = (PACED, WALL)

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioRobot:
    """Name, start (x_m, y_m, heading_rad) and goal of one robot.

    `shifted`: its offset from the first goal equals its offset from the first start.
    """

    robot: str
    start: tuple[float, float, float]
    goal: Destination
    shifted: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A complete description of a run.

    `navigator` may be a reference to one of the user's own. `clock` is PACED for lockstep, at most
    at `speed` times real time, or WALL for wall time.
    """

    world: str
    name: str
    run: WorldRun
    scenario_robots: tuple[ScenarioRobot, ...]
    navigator: str
    side: str
    seed: int
    noise: str | None
    speed: str
    router: bool
    record: str | None
    timeout_s: float
    clock: str = PACED
    calibrated: bool = True
    keep: str | None = None
    locks: str | None = None
    """Folder of the certificates; without one, links are not encrypted."""
    mcu: bool = False
    """Whether the control cores run on emulated boards."""
    mavlink: tuple[str, ...] = ()
    """Endpoints of the MAVLink gateway; without one, none is started."""
    ros2: str | None = None
    """The router of a ROS 2 network, empty for the usual one; None without a ROS 2 gateway."""
    processes: int = 1
    """Number of processes among which the robots are divided."""
    plants: int = 1
    routers: int = 1

    @property
    def level(self) -> str:
        """Name of the noise level; a world may change single values of it."""
        return self.noise or str(self.run.world.noise.get("level", "default"))

    @property
    def lockstep(self) -> bool:
        """True for a run in lockstep, which is repeatable."""
        return self.clock != WALL

    @property
    def pace(self) -> float:
        """Simulated time over real time, at most."""
        return chosen_speed(self.speed)

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the robots."""
        return tuple(scenario_robot.robot for scenario_robot in self.scenario_robots)

    @property
    def hosts(self) -> dict[str, tuple[ScenarioRobot, ...]]:
        """The robots of each robot process, by its role."""
        groups = divided(self.scenario_robots, self.processes)
        return {robot_role([one.robot for one in group]): group for group in groups}

    @property
    def owners(self) -> dict[str, tuple[str, ...]]:
        """The names of each plant's robots, by its role."""
        groups = divided(self.robots, self.plants)
        if len(groups) == 1:
            return {PLANT: groups[0]}
        return {f"{PLANT} of {span(group)}": group for group in groups}

    def asked(self, goal: Destination) -> RunSettings:
        """Return the task of a robot with this goal."""
        world = self.run.world
        return RunSettings(
            world=self.name,
            navigator=name_of(self.navigator),
            seed=self.seed,
            noise=self.level,
            goal_x_m=goal.x_m,
            goal_y_m=goal.y_m,
            goal_heading_rad=goal.heading_rad,
            wire_goal=goal.on_the_wire(),
            # Known only to the goal of the world, from its start.
            shortest_path_m=world.shortest_path_m if goal == goal_in(world) else None,
            timeout_s=self.timeout_s,
        )


class RunOptions(Protocol):
    """Options of `up`; `timeout` in simulated seconds, `goal` None for the world's goal."""

    world: str
    navigator: str
    side: str
    goal: list[float] | None
    robots: int
    speed: str
    clock: str
    seed: int
    noise: str | None
    uncalibrated: bool
    timeout: float
    router: bool
    record: str | None
    keep: str | None
    locks: str | None
    mavlink: list[str]
    ros2: str | None
    mcu: bool
    processes: int | None
    plants: int
    routers: int


def divided(robots: Sequence[T], parts: int) -> list[tuple[T, ...]]:
    """Return the robots in contiguous parts that differ by at most one."""
    ends = [len(robots) * part // parts for part in range(parts + 1)]
    return [tuple(robots[begin:end]) for begin, end in pairwise(ends)]


def span(robots: Sequence[str]) -> str:
    """Return the names of robots that follow one another, for the name of a process."""
    return robots[0] if len(robots) == 1 else f"{robots[0]} to {robots[-1]}"


def robot_role(robots: Sequence[str]) -> str:
    """Return the role of the process of these robots."""
    return f"{'robot' if len(robots) == 1 else 'robots'} {span(robots)}"


def pace_here(robots: int) -> float:
    """Return how many times real time the processors of this computer can drive so many robots."""
    return (os.cpu_count() or 1) * PERIOD_MS / (robots * ROBOT_TICK_MS)


def processes_of(options: RunOptions) -> int:
    """Return among how many processes the robots are divided; UserError if they must not be."""
    robots = options.robots
    if options.processes is None:
        many = robots > MAX_SEPARATE and not (options.mcu or options.locks)
        return min(robots, 2 * (os.cpu_count() or 1)) if many else robots
    if options.processes > robots:
        raise UserError(f"--processes {options.processes}: there are only --robots {robots}")
    if options.processes < robots and (options.mcu or options.locks):
        raise UserError(
            f"--processes {options.processes}: with --locks or --mcu each robot has its own process"
        )
    return options.processes


def scenario_of(options: RunOptions, run: WorldRun) -> Scenario:
    """Return the scenario that the options describe; UserError if the goal is outside."""
    if options.clock == WALL and options.speed != "1":
        raise UserError(
            f"--clock wall runs in real time, not at --speed {options.speed}: use --clock paced"
        )
    pace = pace_here(options.robots)
    if options.clock == WALL and pace < 1.0:
        raise UserError(
            f"--clock wall: {options.robots} robots need {1.0 / pace:.1f} times the processors of"
            " this computer, so they would stop for lack of time: use --clock paced or fewer robots"
        )
    for what, count in (("--plants", options.plants), ("--routers", options.routers)):
        if count > options.robots:
            raise UserError(f"{what} {count}: there are only --robots {options.robots}")
    if options.record is not None and options.robots > MAX_RECORDED:
        raise UserError(
            f"--record: up starts a recorder for each robot, of at most {MAX_RECORDED} robots, not"
            f" of {options.robots}: leave it out, and record the ones you need with"
            " `sidestep rec start --id NAME`"
        )
    if options.locks is not None and options.routers > 1:
        raise UserError(f"--routers {options.routers}: with --locks there is one router")
    goal = goal_in(run.world)
    if options.goal is not None:
        goal = destination(options.goal)
        floor_from(run.world).refuse_outside(f"--goal {goal}", goal.x_m, goal.y_m)
    return Scenario(
        world=options.world,
        name=run.world.name,
        run=run,
        scenario_robots=tuple(scenario_robots_of(goal, run)),
        navigator=options.navigator,
        side=options.side,
        seed=options.seed,
        noise=options.noise,
        speed=options.speed,
        router=options.router or options.robots > 1 or options.routers > 1,
        record=None if options.record is None else str(Path(options.record).resolve()),
        timeout_s=options.timeout,
        clock=options.clock,
        calibrated=not options.uncalibrated,
        keep=options.keep,
        locks=options.locks,
        mavlink=tuple(options.mavlink),
        ros2=options.ros2,
        mcu=options.mcu,
        processes=processes_of(options),
        plants=options.plants,
        routers=options.routers,
    )


def scenario_robots_of(goal: Destination, run: WorldRun) -> Iterator[ScenarioRobot]:
    """Yield the robots where the plant places them; the first one gets the requested goal."""
    for number, (start, place) in enumerate(zip(run.starts, run.goals, strict=True)):
        yield ScenarioRobot(
            robot=f"r{number + 1}",
            start=(start.x_m, start.y_m, start.heading_rad),
            goal=replace(goal, x_m=place.x_m, y_m=place.y_m) if number else goal,
            shifted=place.shifted,
        )


def run_of(options: RunOptions) -> WorldRun:
    """Read the world before anything is started; UserError if the plant refuses it."""
    return run_in(world_facts(command(world_query(options), os.getpid())))


def world_query(options: RunOptions) -> list[str]:
    """Return the command that reads the facts of the world before anything is started."""
    words = ["worlds", "show", options.world, "--json", "--robots", str(options.robots)]
    if options.goal is not None:
        goal = destination(options.goal)
        words += ["--goal", repr(goal.x_m), repr(goal.y_m)]
    return words


def world_facts(words: list[str]) -> dict[str, Any]:
    """Run `sidestep worlds` and return its JSON; its error message becomes a UserError."""
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=SHOW_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise RemoteError(f"reading the world took more than {SHOW_S:g} s") from error
    if done.returncode:
        raise UserError(done.stderr.strip() or "the world cannot be used")
    facts: dict[str, Any] = json.loads(done.stdout)
    return facts


def process_arguments(
    scenario: Scenario, endpoint: str, *further: str
) -> list[tuple[str, list[str]]]:
    """Return role and arguments of each process, in the order in which they are started.

    The plants come last. `further` are the endpoints of further routers, which dial the first one.
    """
    commands = _without_certificates(scenario, (locked(scenario.locks, endpoint), *further))
    return [(role, with_locks(scenario.locks, role, words)) for role, words in commands]


def _without_certificates(
    scenario: Scenario, endpoints: Sequence[str]
) -> list[tuple[str, list[str]]]:
    """Return the same without certificates."""
    commands: list[tuple[str, list[str]]] = []
    endpoint, *further = endpoints
    if scenario.router:
        commands.append((ROUTER, ["router", "--listen", endpoint]))
        for number, one in enumerate(further, 2):
            words = ["router", "--listen", one, "--connect", endpoint]
            commands.append((f"{ROUTER} {number}", words))
    commands += [
        (role, robot(scenario, robots, endpoints[number % len(endpoints)]))
        for number, (role, robots) in enumerate(scenario.hosts.items())
    ]
    if scenario.record is not None:
        keep = [] if scenario.keep is None else ["--keep", scenario.keep]
        words = ["record", scenario.record, *keep, "--connect", endpoint, "--id"]
        commands += [(f"{RECORDER} {name}", [*words, name]) for name in scenario.robots]
    if scenario.mavlink:
        commands.append((GATEWAY_ROLE, gateway(scenario, endpoint)))
    if scenario.ros2 is not None:
        commands.append((ROS2_ROLE, ros2(scenario.ros2, scenario.robots, endpoint)))
    for number, (role, own) in enumerate(scenario.owners.items()):
        words = plant(scenario, endpoints[number % len(endpoints)], own)
        if scenario.lockstep and number == 0:
            words.append("--paused")  # the others wait for it
        commands.append((role, words))
    return commands


def gateway(scenario: Scenario, endpoint: str) -> list[str]:
    """Return the arguments of the MAVLink gateway, which presents all robots."""
    found = ["gateway", *scenario.mavlink, "--robots", ",".join(scenario.robots)]
    found += [] if scenario.record is None else ["--recordings", scenario.record]
    return [*found, "--connect", endpoint]


def ros2(router: str, robots: Sequence[str], endpoint: str) -> list[str]:
    """Return the arguments of the ROS 2 gateway, which presents all robots."""
    where = ["--router", router] if router else []
    return ["rosnode", "--robots", ",".join(robots), *where, "--connect", endpoint]


def robot(scenario: Scenario, robots: Sequence[ScenarioRobot], endpoint: str) -> list[str]:
    """Return the arguments of a robot process. Without a router, the others dial the robot."""
    found = [
        "robot",
        "--id",
        ",".join(one.robot for one in robots),
        "--connect" if scenario.router else "--listen",
        endpoint,
    ]
    if scenario.lockstep:
        found.append("--lockstep")
    if scenario.mcu:
        found.append("--mcu")
    if is_own(scenario.navigator):
        found += ["--navigator", scenario.navigator]
    for one in robots:
        found += ["--start", *start_arguments(*one.start)]
    found += totals_arguments(scenario.run.world.robot)
    settings = settings_of(scenario.run.world.robot, scenario.level, calibrated=scenario.calibrated)
    for parameter, value in settings.items():
        found += ["--param", f"{parameter}={value!r}"]
    return found


def plant(scenario: Scenario, endpoint: str, own: Sequence[str]) -> list[str]:
    """Return the arguments of a plant."""
    found = ["plant", "--world", scenario.world, "--seed", str(scenario.seed)]
    found += ["--robots", ",".join(scenario.robots), "--connect", endpoint]
    if len(own) < len(scenario.robots):
        found += ["--own", ",".join(own)]
    if scenario.noise is not None:
        found += ["--noise", scenario.noise]
    if scenario.lockstep:
        found += ["--lockstep", "--speed", scenario.speed]
    return found
