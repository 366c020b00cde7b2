"""The vocabulary of a scenario: one row for each kind of event, how it is drawn and applied."""

from collections.abc import Callable, Mapping
from random import Random
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from runtime.units import NS_PER_MS
from verification.simulation.actions import OPERATORS, draw_operate
from verification.simulation.events import Argument, Event
from verification.simulation.hosts.attacker import ATTACKS
from verification.simulation.hosts.network import Impairment

if TYPE_CHECKING:
    from verification.simulation.simulation import Simulation

HOSTS: Final = ("robot", "plant", *OPERATORS)
MEASURED_NS: Final = 2_700 * NS_PER_MS
"""An operator measures the robot's clock every 2 s and has the answer within 0.5 s."""

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
        delay_ns=int(delay_ms) * NS_PER_MS,
        jitter_ns=int(jitter_ms) * NS_PER_MS,
        paths=paths,
    )
    late_ms = int(delay_ms) + int(jitter_ms) + 400
    impair(simulation, event, [(str(source), str(target))], impairment, int(for_ms), late_ms)


def draw_queue(random: Random) -> Arguments:
    source, target = pair(random)
    return source, target, random.choice((0.2, 0.5, 0.8)), random.choice((2000, 4000, 8000))


def apply_queue(simulation: "Simulation", event: Event) -> None:
    """The delay of a link grows slowly, so that its frames never fail to come, but late."""
    source, target, growth, for_ms = event.arguments
    impairment = Impairment(growth=float(growth), since_ns=simulation.scheduler.now_ns)
    impair(simulation, event, [(str(source), str(target))], impairment, int(for_ms), 4400)


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
    until_ns = scheduler.now_ns + for_ms * NS_PER_MS
    simulation.oracle.facts.impaired(until_ns + late_ms * NS_PER_MS)
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
    simulation.oracle.facts.held_up(scheduler.now_ns + (back_ms + 1000) * NS_PER_MS)
    back_ns = scheduler.now_ns + back_ms * NS_PER_MS
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
    until_ns = scheduler.now_ns + for_ms * NS_PER_MS
    simulation.oracle.facts.held_up(until_ns + 300 * NS_PER_MS)
    simulation.oracle.facts.impaired(until_ns + 300 * NS_PER_MS)
    if name == "plant":
        simulation.oracle.facts.awake_ns = until_ns
    host.suspend()
    scheduler.at(until_ns, host.resume)


def draw_hang(random: Random) -> Arguments:
    return (span_ms(random),)


def apply_hang(simulation: "Simulation", event: Event) -> None:
    """The robot's loop hangs; its bus goes on."""
    simulation.robot.hang_ns += int(event.arguments[0]) * NS_PER_MS


def draw_busy(random: Random) -> Arguments:
    return random.choice((5, 15, 30, 60, 90)), span_ms(random)


def apply_busy(simulation: "Simulation", event: Event) -> None:
    """The robot's processor is busy: each tick takes longer, in time and in CPU time."""
    late_ms, for_ms = int(event.arguments[0]), int(event.arguments[1])
    robot, scheduler = simulation.robot, simulation.scheduler
    robot.late_ns, robot.stage_cost_ns = late_ms * NS_PER_MS, late_ms * NS_PER_MS // 5
    until_ns = scheduler.now_ns + for_ms * NS_PER_MS
    scheduler.at(until_ns, rested, simulation)


def rested(simulation: "Simulation") -> None:
    simulation.robot.late_ns, simulation.robot.stage_cost_ns = 0, 100_000


# Disk.


def draw_slow_disk(random: Random) -> Arguments:
    return random.choice((30, 100, 250, 1000)), span_ms(random) * 4


def apply_slow_disk(simulation: "Simulation", event: Event) -> None:
    disk = simulation.robot.disk
    disk.slow_ns = int(event.arguments[0]) * NS_PER_MS
    until_ns = simulation.scheduler.now_ns + int(event.arguments[1]) * NS_PER_MS
    simulation.scheduler.at(until_ns, setattr, disk, "slow_ns", 0)


def apply_failing_disk(simulation: "Simulation", event: Event) -> None:
    disk = simulation.robot.disk
    disk.failing = True
    until_ns = simulation.scheduler.now_ns + int(event.arguments[0]) * NS_PER_MS
    simulation.scheduler.at(until_ns, setattr, disk, "failing", False)


def apply_power_cut(simulation: "Simulation", event: Event) -> None:
    """The robot's machine loses power and starts again."""
    simulation.robot.kill()
    simulation.robot.disk.cut_power(event.salt)
    back_ns = simulation.scheduler.now_ns + int(event.arguments[0]) * NS_PER_MS
    simulation.oracle.facts.held_up(back_ns + 1000 * NS_PER_MS)
    simulation.scheduler.at(back_ns, simulation.start_robot)


def draw_rot(random: Random) -> Arguments:
    return random.choice(("fence", "fence", "mission", "parameters")), 300


def apply_rot(simulation: "Simulation", event: Event) -> None:
    """A file is damaged while the robot does not run."""
    name, back_ms = str(event.arguments[0]), int(event.arguments[1])
    simulation.robot.kill()
    if simulation.robot.disk.damage(f"{name}.json"):
        simulation.oracle.keeping.damaged(name)
    back_ns = simulation.scheduler.now_ns + back_ms * NS_PER_MS
    simulation.oracle.facts.held_up(back_ns + 1000 * NS_PER_MS)
    simulation.scheduler.at(back_ns, simulation.start_robot)


# Clocks.


def draw_sleep(random: Random) -> Arguments:
    return random.choice(OPERATORS), span_ms(random)


def apply_sleep(simulation: "Simulation", event: Event) -> None:
    """An operator's machine sleeps; its clock stands still meanwhile."""
    name, for_ms = str(event.arguments[0]), int(event.arguments[1])
    apply_suspend(simulation, event)
    until_ns = simulation.scheduler.now_ns + for_ms * NS_PER_MS
    simulation.scheduler.at(until_ns - 1, step, simulation, name, -for_ms * NS_PER_MS)


def draw_clock(random: Random) -> Arguments:
    step_ms = random.choice((50, 200, 1000, 5000, 3_600_000))
    return random.choice(("robot", "plant", *OPERATORS)), step_ms


def apply_clock(simulation: "Simulation", event: Event) -> None:
    """A machine's clock jumps ahead, as after its virtual machine was moved."""
    name, step_ms = str(event.arguments[0]), int(event.arguments[1])
    facts, now_ns = simulation.oracle.facts, simulation.scheduler.now_ns
    step(simulation, name, step_ms * NS_PER_MS)
    if name in ("robot", "plant"):
        facts.held_up(now_ns + 500 * NS_PER_MS)


def step(simulation: "Simulation", name: str, by_ns: int) -> None:
    """From now on until it is measured anew, operators do not know the robot's clock."""
    facts, now_ns = simulation.oracle.facts, simulation.scheduler.now_ns
    simulation.host(name).clock_offset_ns += by_ns
    if name == "robot":
        simulation.robot.clock_offset_ns += by_ns
    facts.unsure(max(now_ns, facts.sound_since_ns) + MEASURED_NS)


def apply_wall_clock(simulation: "Simulation", event: Event) -> None:
    """The robot's wall clock is set; the monotonic one goes on."""
    by_ns = int(event.arguments[0]) * 1000 * NS_PER_MS
    simulation.robot.wall_step_ns += by_ns
    simulation.robot.host.wall_offset_ns += by_ns


# Attacks.


def draw_attack(random: Random) -> Arguments:
    kind = random.choice((*ATTACKS, "known stops", "known stops"))
    if kind == "known stops":  # as a flood or not at all: one does nothing
        return kind, random.choice((50, 200)), random.choice((0, 1, 5))
    if kind == "wheels":
        return (
            kind,
            random.choice((1, 1, 5, 40)),
            random.choice((0, 7, 50)),
            random.choice((0, 0, -1, -4, 3, 1000, 1 << 32)),
            random.choice((9000, 1 << 30, -9000, 0)),
            random.choice((0, 150, 65_535)),
        )
    return kind, random.choice((1, 5, 50, 200)), random.choice((0, 1, 5, 20, 100))


def apply_attack(simulation: "Simulation", event: Event) -> None:
    kind, count, gap_ms, *more = event.arguments
    simulation.attacker.attack(str(kind), int(count), int(gap_ms), event.salt, tuple(more))


# Operators.


def apply_operate(simulation: "Simulation", event: Event) -> None:
    who, action, *arguments = event.arguments
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
        "queue": Fault(5, draw_queue, apply_queue),
        "cut": Fault(6, draw_cut, apply_cut),
        "kill": Fault(4, draw_kill, apply_kill),
        "suspend": Fault(4, draw_suspend, apply_suspend),
        "hang": Fault(3, draw_hang, apply_hang),
        "busy": Fault(2, draw_busy, apply_busy),
        "slow disk": Fault(2, draw_slow_disk, apply_slow_disk),
        "failing disk": Fault(1, lambda r: (span_ms(r) * 2,), apply_failing_disk),
        "rot": Fault(2, draw_rot, apply_rot),
        "sleep": Fault(2, draw_sleep, apply_sleep),
        "clock": Fault(2, draw_clock, apply_clock),
        "wall clock": Fault(1, lambda r: (r.choice((-86_400, -5, 5, 86_400)),), apply_wall_clock),
        "attack": Fault(6, draw_attack, apply_attack),
        "power cut": Fault(2, lambda r: (r.choice((100, 500, 2000)),), apply_power_cut),
    }
)
