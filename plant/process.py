"""The plant process, `sidestep run plant`: connect a plant to the bus and run it until stopped.

Its loop publishes sensor data, awaits answers and advances one period. Between ticks it answers
requests: start, pause, score.
"""

import argparse
import json
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, isfinite
from queue import SimpleQueue
from time import monotonic
from typing import Final

from plant.model.configuration import LEVELS, noise_of
from plant.other_plants import OtherPlants, shared_world
from plant.robot_link import PlantLink
from plant.shortest_path import known_length_m
from plant.sim.simulation import Plant
from plant.world.file import load
from plant.world.writer import run_json
from protocol.bus.bus import Bus, Presence, claim, open_bus
from protocol.bus.network import Network
from protocol.bus.services import ServiceRequest
from protocol.options import add_network_options, network_of, whole
from protocol.topics import RUN, WORLD, Role, robot_names
from protocol.wire.enums import AckResult, RunAction
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, RunRequest
from protocol.wire.reasons import Reason
from protocol.world import as_json
from runtime import config
from runtime.cli.parsers import new_parser
from runtime.clock import Clock, WakeUp, WallClock, ticks
from runtime.errors import EXIT_FAILURE, EXIT_OK, UserError
from runtime.units import NS_PER_S, PERIOD_S
from runtime.watchdog import Patience, Watchdog

MAX_WAITING: Final = 64
MAX_ANSWERED: Final = 6
"""Requests per iteration of the loop; the score of a run takes up to a millisecond."""


class RequestQueue:
    """Queue of requests, filled by the bus and answered by the plant's loop between ticks.

    The description of the world is constant, so requests for it do not reach the loop.
    """

    def __init__(self, *, running: bool, world: object, nudge: Callable[[], None]) -> None:
        """Create the queue; `nudge` is called by the bus when there is a request."""
        self.running = running
        self.ordered: Callable[[bool], None] = lambda _running: None
        """Called with each START (True) and PAUSE (False)."""

        self._nudge = nudge
        self._world = json.dumps(world).encode()
        self._requests: SimpleQueue[tuple[int, ServiceRequest, RunRequest]] = SimpleQueue()

    def ask(self, robot: int, asked: ServiceRequest) -> None:
        """Enqueue a request, or refuse it if the queue is full; called by the bus."""
        request = asked.message
        if not isinstance(request, RunRequest):
            asked.reply(self._world)
        elif self._requests.qsize() >= MAX_WAITING:
            asked.reply(
                acknowledge(AckResult.TEMPORARILY_REJECTED, Reason.TOO_MANY_REQUESTS),
            )
        else:
            self._requests.put((robot, asked, request))
            self._nudge()

    def serve(self, plant: Plant) -> None:
        """Answer the next few requests; further ones wait for the next iteration of the loop."""
        for _ in range(min(self._requests.qsize(), MAX_ANSWERED)):
            robot, asked, request = self._requests.get_nowait()
            asked.reply(self.answer(plant, robot, request))
        if not self._requests.empty():
            self._nudge()

    def answer(self, plant: Plant, robot: int, request: RunRequest) -> Message:
        """Execute a request and return the answer.

        START resumes a paused plant; on a running one it begins a new score.
        """
        if request.action == RunAction.SCORE:
            return plant.score(request.until_ns, robot)
        if request.action == RunAction.START:
            if self.running:
                plant.restart_score()
        elif request.action != RunAction.PAUSE:
            return acknowledge(AckResult.UNSUPPORTED, Reason.UNKNOWN_COMMAND)
        self.running = request.action == RunAction.START
        self.ordered(self.running)
        return acknowledge(AckResult.ACCEPTED, Reason.NONE)


def acknowledge(result: AckResult, reason: Reason) -> CommandAck:
    """Return a COMMAND_ACK."""
    return CommandAck(command=0, result=result, result_param2=reason)


POLL_S: Final = 0.01
REPEAT_S: Final = 0.5
"""In lockstep, wall time after which a tick is published again: others see that the plant runs, and
a robot that has just joined receives the tick."""
PATIENCE_S: Final = 3.0
"""In lockstep, wall time after which simulated time advances without the answer of a robot that is
present; it counts less while the machine is busy. A supervisor restarts a robot that hangs."""


class Wake:
    """Wake the loop when a frame has arrived or the process must end."""

    def __init__(self) -> None:
        self._called = WakeUp()
        self.stopping = False

    def __call__(self, _: int = 0) -> None:
        """Wake the loop."""
        self._called.wake()

    def stop(self) -> None:
        """End the loop; may be called from a signal handler."""
        self.stopping = True
        self()

    def wait(self, timeout_s: float) -> bool:
        """Return True if something has arrived, False after the timeout."""
        return self._called.wait(timeout_s)


def nothing() -> None:
    """Do nothing."""


@dataclass(slots=True)
class Process:
    """The plant with its links to the robots and its request queue.

    `look` is called once per period, for observers. `turn` is called in each iteration of the loop,
    at least every `REPEAT_S`, also while simulated time is paused. `others`: the plants of the
    other robots of this world; without one of them it ends.
    """

    plant: Plant
    links: list[PlantLink]
    requests: RequestQueue
    wake: Wake
    patience_s: float = PATIENCE_S
    look: Callable[[], None] = nothing
    turn: Callable[[], None] = nothing
    others: OtherPlants | None = None
    _published_s: float = 0.0

    def publish(self) -> None:
        """Publish the data of this tick."""
        self._published_s = monotonic()
        for link in self.links:
            link.publish(self.plant)
        self.look()

    @property
    def silent(self) -> list[PlantLink]:
        """Robots that are expected to answer this tick and have not."""
        return [link for link in self.links if link.expected and not link.answered]

    def advance(self) -> None:
        """Apply the wheel commands and advance one period, in lockstep with the other plants."""
        for link in self.links:
            link.apply_command(self.plant)
        if self.others is None:
            self.plant.advance()
            return
        self.others.tell(self.plant)
        self._await_others(self.others)
        if not self.wake.stopping:
            self.plant.advance(self.others.motions())

    def run_wall(self, clock: Clock) -> None:
        """Run one period of simulated time per period of wall time, paused or not."""
        for _ in ticks(clock, 1.0 / PERIOD_S):
            self._serve()
            self._obey()
            if self.wake.stopping:
                return
            if self.requests.running:
                self.advance()
            self.publish()

    def run_lockstep(self, speed: float = inf) -> None:
        """Advance whenever every expected robot has answered, at most at `speed` x real time.

        Without one of the robots, time advances at most as fast as real time.
        """
        self._await_robots()
        pace_s = 0.0 if speed == inf else PERIOD_S / speed
        due_s = monotonic()
        while not self.wake.stopping:
            self.publish()
            self._await_answers()
            self._await_start()
            is_complete = all(link.expected for link in self.links)
            period_s = pace_s if is_complete else max(pace_s, PERIOD_S)
            due_s = max(due_s + period_s, monotonic() - period_s)
            self._await_due(due_s)
            self.advance()

    def _serve(self) -> None:
        self.turn()
        self.requests.serve(self.plant)
        if self.others is not None and self.others.why_ended:
            self.wake.stop()

    def _obey(self) -> None:
        """Run, pause or begin a new score as another plant was told to."""
        if self.others is not None:
            running, is_new = self.others.take_order(running=self.requests.running)
            self.requests.running = running
            if is_new:
                self.plant.restart_score()

    def _await_due(self, due_s: float) -> None:
        while (remaining_s := due_s - monotonic()) > 0 and not self.wake.stopping:
            self.wake.wait(min(remaining_s, REPEAT_S))
            self._serve()

    def _await_robots(self) -> None:
        """Wait until all robots subscribe: data published before, such as tick 0, would be lost."""
        publishers = [publisher for link in self.links for publisher in link.publishers]
        while not (self.wake.stopping or all(publisher.matched for publisher in publishers)):
            self.wake.wait(POLL_S)
            self._serve()

    def _await_answers(self) -> None:
        """Wait for the expected robots; after `patience_s` expect the silent ones no more."""
        patience: Patience | None = None  # most answers come before it is needed
        while not self.wake.stopping:
            self._serve()
            silent = self.silent
            if not silent:
                return
            patience = patience or Patience(round(self.patience_s * NS_PER_S))
            remaining_s = patience.left_s()
            if remaining_s <= 0.0:
                for link in silent:
                    link.expect_no_more()
                return
            self._wait_or_repeat(remaining_s)

    def _await_start(self) -> None:
        self._obey()
        while not (self.requests.running or self.wake.stopping):
            self._wait_or_repeat(REPEAT_S)
            self._serve()
            self._obey()

    def _await_others(self, others: OtherPlants) -> None:
        """Wait for the other plants, in lockstep only; each sends again what may have been lost."""
        while others.silent and not self.wake.stopping:
            self._wait_or_repeat(REPEAT_S)
            self._serve()
            self._obey()

    def _wait_or_repeat(self, timeout_s: float) -> None:
        """Wait for an arrival, and publish this tick again `REPEAT_S` after the last time."""
        remaining_s = self._published_s + REPEAT_S - monotonic()
        if remaining_s <= 0.0:
            self.publish()
            if self.others is not None:
                self.others.repeat()
        else:
            self.wake.wait(min(timeout_s, remaining_s))


def run(
    plant: Plant,
    network: Network,
    robots: list[str],
    *,
    lockstep: bool,
    speed: float,
    paused: bool,
    own: Sequence[str] = (),
) -> int:
    """Run until stopped and return 0; return 1 if another plant of this world has ended.

    In lockstep the first tick waits for the robots. `own` are the robots of this plant, by default
    all.
    """
    wake = Wake()
    mine = list(own or robots)
    with open_bus(replace(network, patient=lockstep), Role.PLANT, mine[0]) as bus:
        for number in (
            signal.SIGINT,
            signal.SIGTERM,
        ):
            signal.signal(number, lambda *_: wake.stop())
        bus.on_impostor(lambda why: log_line(f"plant: {why}"))
        watchdog = Watchdog()
        process = assemble(
            plant,
            bus,
            robots,
            wake,
            lockstep=lockstep,
            paused=paused,
            turn=watchdog.reset,
            own=mine,
        )
        log_line(f"plant: world {plant.world.name} with {', '.join(mine)}")
        with watchdog:
            if lockstep:
                process.run_lockstep(speed)
            else:
                process.run_wall(WallClock())
    why = process.others.why_ended if process.others else ""
    log_line(f"plant: ends{why and f', because {why}'}")
    return EXIT_FAILURE if why else EXIT_OK


def assemble(
    plant: Plant,
    bus: Bus,
    robots: list[str],
    wake: Wake,
    *,
    lockstep: bool,
    paused: bool,
    turn: Callable[[], None] = nothing,
    own: Sequence[str] | None = None,
) -> Process:
    """Create the links to the robots and the services, and announce them. Raises NameTakenError."""
    own = robots if own is None else own
    numbers = {number: robot for number, robot in enumerate(robots) if robot in own}
    world = as_json(plant.world, known_length_m(plant.world))
    world |= run_json(plant.world, plant.seed, plant.noise)
    desk = RequestQueue(running=not paused, world=world, nudge=wake)
    wires = [
        PlantLink(bus, robot, number, wake, lockstep=lockstep) for number, robot in numbers.items()
    ]
    others = None
    if away := {n: robot for n, robot in enumerate(robots) if n not in numbers}:
        facts = shared_world(world, robots)
        others = OtherPlants(bus, numbers, away, facts, wake, lockstep=lockstep)
        desk.ordered = lambda running: others.order(running=running)
    for number, robot in numbers.items():
        take = partial(desk.ask, number)
        bus.serve(RUN, take, robot)
        bus.serve(WORLD, take, robot)
    claim(bus, list(numbers.values()))
    if lockstep or others is not None:
        watch_processes(bus, wires, others, wake)
    look = RejectLog(lambda: bus.rejected, log_line).look
    return Process(plant, wires, desk, wake, look=look, turn=turn, others=others)


def watch_processes(
    bus: Bus, links: list[PlantLink], others: OtherPlants | None, wake: Wake
) -> None:
    """Tell which robots and plants are present, so that no tick waits for one that has gone."""
    of = {link.robot: link for link in links}

    def note(token: Presence, appeared: bool) -> None:
        if token.robot in of:
            of[token.robot].note_presence(token, appeared)
        if others is not None:
            others.note_presence(token, appeared)
        wake()

    bus.watch(note)


def log_line(line: str) -> None:
    """Print a line to standard error."""
    print(line, file=sys.stderr, flush=True)


class RejectLog:
    """Report rejected frames at once, and again whenever their number has doubled.

    `counts` returns the numbers of rejected frames by path; `report` receives each line.
    """

    def __init__(
        self, counts: Callable[[], Mapping[str, int]], report: Callable[[str], None]
    ) -> None:
        self._counts = counts
        self._report = report
        self._reported: dict[str, int] = {}

    def look(self) -> None:
        """Report the counts that have grown."""
        for path, count in self._counts().items():
            if count > 2 * self._reported.get(path, 0):
                self._reported[path] = count
                what = f"{count} rejected on {path}"
                self._report(f"plant: {what}: find out which other process publishes there")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantSettings:
    """Settings of `--config FILE`: robot and network."""

    robot: str = "r1"
    network: Network | None = None


def main(argv: Sequence[str]) -> int:
    """Run the plant until it is stopped; return 0, or 2 for a bad world or wrong settings."""
    arguments = parser().parse_args(list(argv))
    settings = (
        config.load_shared(arguments.config, PlantSettings) if arguments.config else PlantSettings()
    )
    network = network_of(arguments, settings.network, listens=False)
    robots = robot_names(
        "--robots", settings.robot if arguments.robots is None else arguments.robots
    )
    own = robots if arguments.own is None else robot_names("--own", arguments.own)
    if strangers := [name for name in own if name not in robots]:
        raise UserError(f"--own {strangers[0]}: is not one of --robots {','.join(robots)}")
    return run(
        plant_of(arguments, len(robots), [robots.index(name) for name in own]),
        network,
        robots,
        lockstep=arguments.lockstep,
        speed=arguments.speed,
        paused=arguments.paused,
        own=own,
    )


def plant_of(arguments: argparse.Namespace, robots: int, own: Sequence[int] | None = None) -> Plant:
    """Return the plant of the command line; raise UserError for an unusable world."""
    world = load(arguments.world)
    noise = noise_of(world, arguments.noise)
    try:
        return Plant(world, arguments.seed, noise, robots=robots, own=own)
    except ValueError as error:
        raise UserError(f"world {arguments.world}: {error}") from error


def parser() -> argparse.ArgumentParser:
    """Return the parser of `sidestep run plant`."""
    parser = new_parser("plant")
    add_network_options(parser)
    parser.add_argument(
        "--world", metavar="W", default="box", help="a world's name or file (default box)"
    )
    parser.add_argument(
        "--seed",
        metavar="S",
        type=whole(0),
        default=0,
        help="seed of all random numbers (default 0)",
    )
    parser.add_argument("--noise", metavar="LEVEL", choices=sorted(LEVELS), help=", ".join(LEVELS))
    parser.add_argument("--robots", metavar="NAMES", help="as in r1,r2 (default r1)")
    parser.add_argument(
        "--own",
        metavar="NAMES",
        help="those of --robots that this plant simulates; other plants simulate the others (all)",
    )
    parser.add_argument("--lockstep", action="store_true", help="advance when all robots answered")
    parser.add_argument(
        "--speed",
        metavar="F",
        type=speed,
        default=inf,
        help="in lockstep, times real time (default max)",
    )
    parser.add_argument("--paused", action="store_true", help="wait for a START")
    return parser


def speed(text: str) -> float:
    """Parse a factor above zero, or `max`."""
    value = inf if text == "max" else float(text)
    if not value > 0 or (not isfinite(value) and text != "max"):
        raise argparse.ArgumentTypeError(f"{text!r}: a number above 0, or max")
    return value
