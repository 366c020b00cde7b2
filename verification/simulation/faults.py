"""The vocabulary of a scenario: one row for each kind of event, how it is drawn and applied."""

from collections.abc import Callable, Mapping
from random import Random
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from verification.simulation.events import Argument, Event
from verification.simulation.network import Impairment

if TYPE_CHECKING:
    from verification.simulation.simulation import Simulation

MS: Final = 1_000_000
HOSTS: Final = ("robot", "plant", "operator-a", "operator-b")
OPERATORS: Final = ("operator-a", "operator-b")
TOPIC_GROUPS: Final = ("", "sense/", "drive/", "op/", "tlm/", "srv/", "op/heartbeat")

Arguments = tuple[Argument, ...]


class Fault(NamedTuple):
    """`weight` is how often it is drawn beside the others; `draw` makes its arguments."""

    weight: int
    draw: Callable[[Random], Arguments]
    apply: Callable[["Simulation", Event], None]


# Network.


def pair(random: Random) -> tuple[str, str]:
    """Two hosts, one of them mostly the robot."""
    other = random.choice(HOSTS[1:])
    return (("robot", other), (other, "robot"))[random.randrange(2)]


def span_ms(random: Random) -> int:
    """How long something lasts: mostly short, at times for seconds."""
    return random.choice((60, 120, 200, 300, 500, 800, 1200, 2000, 4000))


def draw_rough(random: Random) -> Arguments:
    source, target = pair(random)
    return (
        source,
        target,
        random.choice(TOPIC_GROUPS),
        random.choice((0.0, 0.0, 0.1, 0.3, 0.6, 0.9)),
        random.choice((0.0, 0.0, 0.2, 0.6)),
        random.choice((0.0, 0.0, 0.2, 0.6)),
        random.choice((0, 0, 0, 20, 100, 300, 1000, 3000)),
        random.choice((0, 0, 30, 150)),
        span_ms(random) * 2,
    )


def apply_rough(simulation: "Simulation", event: Event) -> None:
    source, target, group, loss, double, swap, delay_ms, jitter_ms, for_ms = event.arguments
    paths = (str(group),) if group else ()
    impairment = Impairment(
        loss=float(loss),
        duplicate=float(double),
        reorder=float(swap),
        delay_ns=int(delay_ms) * MS,
        jitter_ns=int(jitter_ms) * MS,
        paths=paths,
    )
    late_ms = int(delay_ms) + int(jitter_ms) + 400
    impair(simulation, event, [(str(source), str(target))], impairment, int(for_ms), late_ms)


def draw_cut(random: Random) -> Arguments:
    source, target = pair(random)
    return source, target, random.randrange(2), span_ms(random)


def apply_cut(simulation: "Simulation", event: Event) -> None:
    source, target, both, for_ms = event.arguments
    ways = [(str(source), str(target))]
    if both:
        ways.append((str(target), str(source)))
    impair(simulation, event, ways, Impairment(loss=1.0), int(for_ms), 0)


def impair(
    simulation: "Simulation",
    event: Event,
    ways: list[tuple[str, str]],
    impairment: Impairment,
    for_ms: int,
    late_ms: int,
) -> None:
    """Impair links for a while."""
    scheduler = simulation.scheduler
    until_ns = scheduler.now_ns + for_ms * MS
    simulation.oracle.impaired(until_ns + late_ms * MS)
    for number, (source, target) in enumerate(ways):
        link = simulation.network.link(source, target)
        link.add(impairment, event.salt + number)
        scheduler.at(until_ns, link.remove, impairment)


# Processes.


def draw_kill(random: Random) -> Arguments:
    back_ms = random.choice((100, 300, 1000, 2500, 60_000))
    return random.choice(("robot", "robot", "plant", *OPERATORS)), back_ms


def apply_kill(simulation: "Simulation", event: Event) -> None:
    name, back_ms = str(event.arguments[0]), int(event.arguments[1])
    scheduler = simulation.scheduler
    simulation.oracle.held_up(scheduler.now_ns + (back_ms + 1000) * MS)
    back_ns = scheduler.now_ns + back_ms * MS
    if name == "robot":
        simulation.robot.kill()
        scheduler.at(back_ns, simulation.start_robot)
    elif name == "plant":
        simulation.plant.kill()
        scheduler.at(back_ns, simulation.plant.start)
    else:
        simulation.operators[name].kill()
        scheduler.at(back_ns, simulation.operators[name].start)


def draw_suspend(random: Random) -> Arguments:
    return random.choice(HOSTS), span_ms(random)


def apply_suspend(simulation: "Simulation", event: Event) -> None:
    name, for_ms = str(event.arguments[0]), int(event.arguments[1])
    scheduler, host = simulation.scheduler, simulation.host(name)
    until_ns = scheduler.now_ns + for_ms * MS
    simulation.oracle.held_up(until_ns + 300 * MS)
    simulation.oracle.impaired(until_ns + 300 * MS)
    host.suspend()
    scheduler.at(until_ns, host.resume)


def draw_hang(random: Random) -> Arguments:
    return (span_ms(random),)


def apply_hang(simulation: "Simulation", event: Event) -> None:
    """The robot's loop hangs; its bus goes on."""
    simulation.robot.hang_ns += int(event.arguments[0]) * MS


def draw_busy(random: Random) -> Arguments:
    return random.choice((5, 15, 30, 60, 90)), span_ms(random)


def apply_busy(simulation: "Simulation", event: Event) -> None:
    """The robot's processor is busy: each tick takes longer, in time and in CPU time."""
    late_ms, for_ms = int(event.arguments[0]), int(event.arguments[1])
    robot, scheduler = simulation.robot, simulation.scheduler
    robot.late_ns, robot.stage_cost_ns = late_ms * MS, late_ms * MS // 5
    until_ns = scheduler.now_ns + for_ms * MS
    scheduler.at(until_ns, rested, simulation)


def rested(simulation: "Simulation") -> None:
    simulation.robot.late_ns, simulation.robot.stage_cost_ns = 0, 100_000


# Disk.


def draw_slow_disk(random: Random) -> Arguments:
    return random.choice((30, 100, 250, 1000)), span_ms(random) * 4


def apply_slow_disk(simulation: "Simulation", event: Event) -> None:
    disk = simulation.robot.disk
    disk.slow_ns = int(event.arguments[0]) * MS
    until_ns = simulation.scheduler.now_ns + int(event.arguments[1]) * MS
    simulation.scheduler.at(until_ns, setattr, disk, "slow_ns", 0)


def apply_failing_disk(simulation: "Simulation", event: Event) -> None:
    disk = simulation.robot.disk
    disk.failing = True
    until_ns = simulation.scheduler.now_ns + int(event.arguments[0]) * MS
    simulation.scheduler.at(until_ns, setattr, disk, "failing", False)


def apply_power_cut(simulation: "Simulation", event: Event) -> None:
    """The robot's machine loses power and starts again."""
    simulation.robot.kill()
    simulation.robot.disk.cut_power(event.salt)
    back_ns = simulation.scheduler.now_ns + int(event.arguments[0]) * MS
    simulation.oracle.held_up(back_ns + 1000 * MS)
    simulation.scheduler.at(back_ns, simulation.start_robot)


# Operators.


def draw_operate(random: Random) -> Arguments:
    """An operator does something; most of it leads to driving."""
    who = random.choice((*OPERATORS[:1] * 3, OPERATORS[1]))
    return (who, *ACTIONS[random.choices(range(len(ACTIONS)), WEIGHTS)[0]][1](random))


def place(random: Random) -> tuple[float, float]:
    """Somewhere near the start, mostly ahead."""
    return (
        round(30.0 + random.uniform(-1.0, 3.0), 2),
        round(30.0 + random.uniform(-1.0, 1.0), 2),
    )


def mission(random: Random) -> Arguments:
    stops = [coordinate for _ in range(random.randint(1, 3)) for coordinate in place(random)]
    return ("mission", random.choice((0.0, 0.5, 2.0)), *stops)


ACTIONS: Final[tuple[tuple[int, Callable[[Random], Arguments]], ...]] = (
    (8, lambda random: ("drive", *place(random), "GUIDED")),
    (4, lambda random: ("drive", *place(random), "AUTO")),
    (4, mission),
    (
        5,
        lambda random: (
            "teleop",
            random.choice((0.3, 0.2, -0.2)),
            random.choice((0.0, 0.0, 0.8)),
            random.choice((0.5, 1.5, 4.0)),
        ),
    ),
    (4, lambda _: ("stop",)),
    (2, lambda _: ("order", "clear-estop")),
    (1, lambda _: ("order", "arm")),
    (2, lambda _: ("order", "disarm")),
    (2, lambda _: ("order", "hold")),
    (2, lambda _: ("order", "resume")),
    (1, lambda _: ("order", "abort")),
    (2, lambda _: ("order", "rtl")),
    (2, lambda random: ("mode", random.choice(("GUIDED", "AUTO", "HOLD", "MANUAL")))),
    (3, lambda random: ("lease", random.choice(("TAKE", "TAKE", "SEIZE", "RELEASE")))),
    (3, lambda random: ("param", "d_obs_m", random.choice((0.2, 0.25, 0.31)))),
    (2, lambda random: ("fence", random.choice((0.0, 0.8, 1.5, 5.0)))),
)
WEIGHTS: Final = [weight for weight, _ in ACTIONS]


def apply_operate(simulation: "Simulation", event: Event) -> None:
    who, action, *arguments = event.arguments
    if action == "stop" and simulation.operators[str(who)].host.alive:
        simulation.oracle.pressed()
    simulation.operators[str(who)].do(str(action), tuple(arguments))


def apply_come(simulation: "Simulation", event: Event) -> None:
    """An operator comes; it takes the lease or merely beats."""
    who, lease = str(event.arguments[0]), int(event.arguments[1])
    operator = simulation.operators[who]
    operator.start()
    operator.beating = True
    if lease:
        operator.do("lease", ("TAKE",))


def apply_leave(simulation: "Simulation", event: Event) -> None:
    """An operator's process ends and does not come back."""
    simulation.operators[str(event.arguments[0])].kill()


FAULTS: Final[Mapping[str, Fault]] = MappingProxyType(
    {
        "come": Fault(0, lambda r: (r.choice(OPERATORS), r.randrange(2)), apply_come),
        "operate": Fault(0, draw_operate, apply_operate),
        "leave": Fault(2, lambda r: (r.choice(OPERATORS),), apply_leave),
        "rough": Fault(8, draw_rough, apply_rough),
        "cut": Fault(6, draw_cut, apply_cut),
        "kill": Fault(4, draw_kill, apply_kill),
        "suspend": Fault(4, draw_suspend, apply_suspend),
        "hang": Fault(3, draw_hang, apply_hang),
        "busy": Fault(2, draw_busy, apply_busy),
        "slow disk": Fault(2, draw_slow_disk, apply_slow_disk),
        "failing disk": Fault(1, lambda r: (span_ms(r) * 2,), apply_failing_disk),
        "power cut": Fault(2, lambda r: (r.choice((100, 500, 2000)),), apply_power_cut),
    }
)
