"""Deterministic simulation of the whole stack: run seeds, and report speed and violations.

Each seed draws operators, faults and attacks over 20 simulated seconds. A seed that violates an
invariant is shrunk to the fewest events and a shorter run; `--events FILE` writes them, `--replay
FILE` runs them. `--defects` puts fixed defects back and counts the seeds that find each. `--seed S
--replay` runs one seed twice and compares the two runs bit by bit.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from random import Random
from time import process_time
from typing import Final, NamedTuple

from checks.harness.figures import BenchmarkReport, figure
from checks.simulation.defects import DEFECTS, Defect
from checks.simulation.hosts.mavlink import CLIENTS, GATEWAY
from checks.simulation.hosts.substitutes import simulated
from checks.simulation.hosts.virtual_time import (
    OPERATORS,
    STATION,
    Event,
    EventScenario,
    from_json,
    to_json,
)
from checks.simulation.invariants.limits import BOOT_NS, Coverage
from checks.simulation.simulation import (
    CLIENT_ACTIONS,
    FAULTS,
    Arguments,
    RunResult,
    Simulation,
    draw_client,
    draw_driving,
    draw_operate,
    place,
    span_ms,
)
from runtime.units import NS_PER_MS, NS_PER_S

DURATION_NS: Final = 20 * NS_PER_S
BY_STATION: Final = 0.12
"""Share of seeds whose first operator uses the ground station."""

PRESSED: Final = {"come": 0.0, "operate": 0.0, "attack": 0.5}
"""Share of events of a kind that are followed by an emergency stop; of other kinds, a tenth."""

SETS_OFF: Final = 0.7
"""Share of seeds in which an operator begins by driving."""

QUIET: Final = 0.1
"""Share of seeds without any fault."""

FENCED: Final = 0.12
"""Share of seeds that begin with a close fence, and a drive that meets it."""

SEIZED: Final = 0.2
"""Share of manual drives during which another operator seizes the lease."""

RESTARTED: Final = 0.15
"""Share of emergency stops after which the robot is restarted, and then asked to drive."""

UNLINKED: Final = 0.1
"""Share of seeds in which the first operator loses its link, and with it perhaps its place."""

LOCKSTEP: Final = 0.08
"""Share of seeds in lockstep. In each the plant's clock stands still for a while, during which an
emergency stop is pressed."""

GATEWAY_EVERY: Final = 4
"""One seed in so many has a gateway with two clients, unless it is in lockstep. What it draws is
drawn apart, so that all else of the seed stays as it is."""

LEFT_TO_CLIENTS: Final = 0.6
"""Share of these seeds without other operators."""

FOLLOWED: Final[tuple[tuple[str, float, int, Arguments], ...]] = (
    ("drive", 0.3, 4000, ("silence", 8.0)),
    ("target", 0.3, 3000, ("flood", 8)),
    ("steer", 0.3, 1500, ("flood", 8)),
    ("flood", 0.4, 200, ("stop",)),
    ("forge", 0.1, 300, ("stop",)),
    ("clear", 0.3, 100, ("stop",)),
    ("stop", 0.8, 1500, ("clear", 1)),
    ("clear", 0.6, 1000, ("drive", 32.0, 30.0)),
)
"""An action of a client, the share in which another one follows, within how many milliseconds, and
that one. Stops are pressed by either client."""

IN_LOCKSTEP: Final = ("come", "operate", "leave", "kill", "attack", "crossing", "rot")
"""Faults in lockstep; those of links and clocks would hold the plant's clock up as well.

After its wall clock was set back, a robot that restarts counts as an older one for 1 s."""


def draw_scenario(seed: int) -> EventScenario:
    """Return the scenario of a seed: operators that start and act, and faults meanwhile."""
    random = Random(f"scenario {seed}")
    lockstep = random.random() < LOCKSTEP
    first = STATION if random.random() < BY_STATION else OPERATORS[0]
    events = [Event(BOOT_NS, "come", (first, random.randrange(2)), random.getrandbits(32))]
    for name, share in (("operator-b", 0.4), ("operator-c", 0.15)):
        if random.random() < share:
            events.append(_event(random, "come", (name, random.randrange(2)), DURATION_NS))
    if random.random() < FENCED:
        events += _fenced(random, first)
    elif random.random() < SETS_OFF:
        events.append(_event(random, "operate", (first, *draw_driving(random)), 6 * NS_PER_S))
    kinds = ["operate"] * random.randint(3, 9)
    if random.random() >= QUIET:
        possible = IN_LOCKSTEP if lockstep else tuple(FAULTS)
        weights = [FAULTS[kind].weight for kind in possible]
        kinds += random.choices(possible, weights, k=random.randint(1, 5))
    for kind in kinds:
        action = draw_operate(random, first) if kind == "operate" else None
        events.append(_event(random, kind, action, DURATION_NS))
    events += _link(Random(f"links {seed}"), first, DURATION_NS)
    if lockstep:
        events += _stand(random, first, DURATION_NS)
    events += [stop for event in events for stop in _stop_under(random, event, first)]
    events += [more for event in events for more in _seizure_under(random, event)]
    events += [more for event in events for more in _restart_under(random, event, first)]
    if seed % GATEWAY_EVERY == GATEWAY_EVERY - 1 and not lockstep:
        events = _with_gateway(Random(f"gateway {seed}"), events, DURATION_NS)
    return EventScenario(seed, DURATION_NS, tuple(sorted(events)), lockstep)


def _with_gateway(random: Random, others: list[Event], duration_ns: int) -> list[Event]:
    """Return the events with a gateway, its clients' actions and faults on their way."""
    if random.random() < LEFT_TO_CLIENTS:
        others = [one for one in others if one.kind not in ("come", "operate", "crossing")]
    first = random.choice(tuple(CLIENTS))
    drive = (first, *random.choice(CLIENT_ACTIONS[:3])[1](random))
    events = [_event(random, "client", drive, 6 * NS_PER_S)]
    events += [
        _event(random, "client", draw_client(random), duration_ns)
        for _ in range(random.randint(4, 12))
    ]
    for event in events:  # also those that follow
        name, did = event.arguments[:2]
        for begun, share, within_ms, action in FOLLOWED:
            if did == begun and random.random() < share:
                time_ns = event.time_ns + random.randrange(within_ms) * NS_PER_MS
                who = random.choice(tuple(CLIENTS)) if action == ("stop",) else name
                events.append(Event(time_ns, "client", (who, *action), 0))
    for _ in range(random.choice((0, 0, 1, 2, 3))):
        kind = random.choice(tuple(ON_THE_WAY))
        events.append(_event(random, kind, ON_THE_WAY[kind](random), duration_ns))
    return [Event(BOOT_NS, "gateway", (), 0), *events, *others]


def _links_of_clients(random: Random) -> tuple[str, str]:
    """Draw a direction of a link between a client and the robot."""
    ends = random.choice((*((name, GATEWAY) for name in CLIENTS), (GATEWAY, "robot")))
    return ends if random.randrange(2) else (ends[1], ends[0])


ON_THE_WAY: Final[dict[str, Callable[[Random], Arguments]]] = {
    "rough": lambda random: (*_links_of_clients(random), *FAULTS["rough"].draw(random)[2:]),
    "queue": lambda random: (*_links_of_clients(random), *FAULTS["queue"].draw(random)[2:]),
    "cut": lambda random: (*_links_of_clients(random), *FAULTS["cut"].draw(random)[2:]),
    "kill": lambda random: (GATEWAY, random.choice((100, 300, 1000, 2500))),
    "suspend": lambda random: (random.choice((GATEWAY, *CLIENTS)), span_ms(random)),
    "clock": lambda random: (GATEWAY, *FAULTS["clock"].draw(random)[1:]),
    "link": lambda random: (GATEWAY, *FAULTS["link"].draw(random)[1:]),
}
"""Faults of the gateway, its clients and their links."""


def _link(random: Random, first: str, duration_ns: int) -> list[Event]:
    """Return that the first operator's link breaks, and a stop meanwhile or later, at times."""
    if random.random() >= UNLINKED:
        return []
    broken = _event(random, "link", (first, *FAULTS["link"].draw(random)[1:]), duration_ns)
    time_ns = broken.time_ns + random.randrange(0, 4000) * NS_PER_MS
    return [broken, Event(time_ns, "operate", (first, "stop"), random.getrandbits(32))]


def _fenced(random: Random, first: str) -> list[Event]:
    """Return a close fence and a drive that meets it."""
    at_ns = BOOT_NS + random.randrange(500, 3000) * NS_PER_MS
    fence = (first, "fence", random.choice((0.4, 0.7, 1.1)), random.choice((0, 0, 1)))
    drive = random.choice((("teleop", 0.3, 0.0, 6.0), ("drive", *place(random), "GUIDED")))
    return [
        Event(at_ns, "operate", fence, random.getrandbits(32)),
        Event(at_ns + 1, "operate", (first, *drive), random.getrandbits(32)),
    ]


def _stand(random: Random, first: str, duration_ns: int) -> list[Event]:
    """Return that the plant's clock stands still, and a stop during that."""
    stand = _event(random, "stand", None, duration_ns - 2 * NS_PER_S)
    time_ns = stand.time_ns + random.randrange(50, 500) * NS_PER_MS
    return [stand, Event(time_ns, "operate", (first, "stop"), random.getrandbits(32))]


def _seizure_under(random: Random, event: Event) -> list[Event]:
    """Return that another operator seizes the lease during a manual drive, at times."""
    if event.arguments[1:2] != ("teleop",) or random.random() >= SEIZED:
        return []
    other = random.choice([name for name in OPERATORS[:3] if name != event.arguments[0]])
    time_ns = event.time_ns + random.randrange(100, 1500) * NS_PER_MS
    return [
        Event(time_ns - 100 * NS_PER_MS, "come", (other, 0), random.getrandbits(32)),
        Event(time_ns, "operate", (other, "lease", "SEIZE"), random.getrandbits(32)),
    ]


def _restart_under(random: Random, event: Event, first: str) -> list[Event]:
    """Return that the robot is restarted after an emergency stop and told to drive, at times."""
    if event.arguments[1:2] != ("stop",) or random.random() >= RESTARTED:
        return []
    time_ns = event.time_ns + random.randrange(1200, 3000) * NS_PER_MS
    restart = FAULTS["restart"].draw(random)
    drive = (first, *draw_driving(random))
    return [
        Event(time_ns, "restart", restart, random.getrandbits(32)),
        Event(time_ns + 3 * NS_PER_S, "operate", drive, random.getrandbits(32)),
    ]


def _stop_under(random: Random, event: Event, first: str) -> list[Event]:
    """Return an emergency stop soon after an event, at times."""
    share = PRESSED.get(event.kind, 0.1)
    if random.random() >= share:
        return []
    time_ns = event.time_ns + random.randrange(800) * NS_PER_MS
    return [Event(time_ns, "operate", (first, "stop"), random.getrandbits(32))]


def _event(
    random: Random, kind: str, arguments: tuple[int | float | str, ...] | None, duration_ns: int
) -> Event:
    time_ns = (
        BOOT_NS + round(random.random() * (duration_ns - 2 * NS_PER_S) / NS_PER_MS) * NS_PER_MS
    )
    if arguments is None:
        arguments = FAULTS[kind].draw(random)
    return Event(time_ns, kind, arguments, random.getrandbits(32))


CHUNK: Final = 20
CHUNKS_EACH: Final = 10
"""A process is replaced after this many chunks, because each run leaves some memory behind."""

MOST_HUNTED: Final = 2000
"""A defect that was put back must be found within this many seeds."""


def run(scenario: EventScenario, defect: str = "") -> RunResult:
    """Run a scenario with everything simulated that would block.

    `defect` names a row of `defects.DEFECTS`: a fixed defect that is put back.
    """
    with simulated(*((DEFECTS[defect].patches,) if defect else ())):
        return Simulation(scenario).run()


class BatchResult(NamedTuple):
    """The results of some seeds: CPU time, failed runs and coverage."""

    seeds: int
    simulated_ns: int
    cpu_s: float
    failed: tuple[RunResult, ...]
    coverage: Coverage


class Campaign(NamedTuple):
    """What seeds stand for: how a scenario is drawn and run, and the defects that can be put back.

    `name` is that of the benchmark, `failure` names its figure of seeds that fail, and `pace` is
    the least simulated time per CPU time.
    """

    name: str
    draw: Callable[[int], EventScenario]
    run: Callable[[EventScenario, str], RunResult]
    defects: Mapping[str, Defect]
    failure: str = "seeds that violate an invariant"
    pace: float | None = None

    def result_of(self, seed: int, defect: str = "") -> RunResult:
        """Run a seed."""
        return self.run(self.draw(seed), defect)


SIMULATE: Final = Campaign("simulate", draw_scenario, run, DEFECTS, pace=100)


def run_seeds(
    seeds: Iterable[int], result_of: Callable[[int], RunResult] = SIMULATE.result_of
) -> BatchResult:
    """Run seeds in this process, one after the other."""
    began_s, count, simulated_ns = process_time(), 0, 0
    failed: list[RunResult] = []
    coverage = Coverage()
    for seed in seeds:
        result = result_of(seed)
        count += 1
        simulated_ns += result.simulated_ns
        coverage.add(result.coverage)
        if result.violation is not None:
            failed.append(result)
    return BatchResult(count, simulated_ns, process_time() - began_s, tuple(failed), coverage)


def run_drawn(
    draw: Callable[[int], EventScenario],
    execute: Callable[[EventScenario, str], RunResult],
    seed: int,
) -> RunResult:
    """Run a seed, in another process: defects are functions that do not pass to it."""
    return execute(draw(seed), "")


def run_in_processes(
    campaign: Campaign, first: int, count: int, jobs: int
) -> Iterator[BatchResult]:
    """Run seeds in `jobs` processes and yield the batches in the order of the seeds."""
    starts = range(first, first + count, CHUNK)
    chunks = [range(start, min(start + CHUNK, first + count)) for start in starts]
    with get_context("spawn").Pool(jobs, maxtasksperchild=CHUNKS_EACH) as pool:
        result_of = partial(run_drawn, campaign.draw, campaign.run)
        yield from pool.imap(partial(run_seeds, result_of=result_of), chunks)


class DefectSearch(NamedTuple):
    """The search for a defect: the number of seeds, and the failed run if one was found."""

    defect: str
    seeds: int
    found: RunResult | None


def search_defect(
    defect: str, first: int = 0, most: int = MOST_HUNTED, campaign: Campaign = SIMULATE
) -> DefectSearch:
    """Put a fixed defect back and run seeds until one violates an invariant."""
    for number, seed in enumerate(range(first, first + most), 1):
        result = campaign.result_of(seed, defect)
        if result.violation is not None:
            return DefectSearch(defect, number, result)
    return DefectSearch(defect, most, None)


TAIL_NS: Final = 50_000_000
MAX_RUNS: Final = 400


def shrink(failed: RunResult, execute: Callable[[EventScenario], RunResult] = run) -> RunResult:
    """Return the smallest scenario found that violates the same invariant, with its result.

    Delta debugging over the list of events: first halves are left out, then quarters, down to
    single events. Raise ValueError for a result without a violation.
    """
    if failed.violation is None:
        raise ValueError("there is no violation to shrink")
    return _Shrinking(failed, failed.violation.invariant, execute).result()


class _Shrinking:
    def __init__(
        self, failed: RunResult, invariant: str, execute: Callable[[EventScenario], RunResult]
    ) -> None:
        self._best = failed
        self._invariant = invariant
        self._execute = execute
        self._left = MAX_RUNS

    def result(self) -> RunResult:
        """Shrink until no single event can be left out."""
        self._try(self._best.scenario.events)
        parts = 2
        while len(events := self._best.scenario.events) > 1 and self._left:
            parts = min(parts, len(events))
            if self._without_a_part(events, parts):
                parts = max(parts - 1, 2)
            elif parts == len(events):
                break
            else:
                parts *= 2
        return self._best

    def _without_a_part(self, events: Sequence[Event], parts: int) -> bool:
        """Leave out one of the parts if possible, and return whether it was."""
        for number in range(parts):
            first, last = len(events) * number // parts, len(events) * (number + 1) // parts
            if self._try((*events[:first], *events[last:])):
                return True
        return False

    def _try(self, events: Sequence[Event]) -> bool:
        best = self._best
        if best.violation is None or not self._left:
            return False
        self._left -= 1
        until_ns = best.violation.time_ns + TAIL_NS
        kept = tuple(event for event in events if event.time_ns <= until_ns)
        period_ns = 50_000_000
        duration_ns = -(-until_ns // period_ns) * period_ns
        found = self._execute(best.scenario._replace(duration_ns=duration_ns, events=kept))
        if found.violation is None or found.violation.invariant != self._invariant:
            return False
        self._best = found
        return True


MAX_SHOWN: Final = 5
AGAIN: Final = ""
"""`--replay` without a file."""


def add_options(parser: argparse.ArgumentParser, campaign: Campaign = SIMULATE) -> None:
    """Add the options of `bench simulate`, or of another campaign."""
    parser.add_argument("--seeds", type=int, default=500, metavar="N", help="number of seeds (500)")
    parser.add_argument(
        "--from", dest="first", type=int, default=0, metavar="S", help="first seed (0)"
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="K", help="processes (1)")
    parser.add_argument("--seed", type=int, metavar="S", help="run only this seed")
    parser.add_argument(
        "--replay",
        nargs="?",
        const=AGAIN,
        metavar="FILE",
        help="run the seed twice and compare; with FILE run its events",
    )
    parser.add_argument("--events", type=Path, metavar="FILE", help="file for the shrunk events")
    parser.add_argument(
        "--defects",
        nargs="*",
        choices=campaign.defects,
        metavar="NAME",
        help="put fixed defects back, these or all, and count the seeds that find each",
    )
    parser.add_argument("--no-shrink", action="store_true", help="keep the events as drawn")


def measure(options: argparse.Namespace, campaign: Campaign = SIMULATE) -> BenchmarkReport:
    """Run one scenario, many seeds, or the search for defects."""
    if options.defects is not None:
        return _report_of_defects(options, campaign)
    if options.replay not in (None, AGAIN):
        scenario = from_json(Path(options.replay).read_text("utf-8"))
        return _report_of_one(options, campaign, campaign.run(scenario, ""))
    if options.seed is not None:
        return _report_of_one(options, campaign, campaign.result_of(options.seed))
    done: list[BatchResult] = []
    for part in run_in_processes(campaign, options.first, options.seeds, options.jobs):
        done.append(part)
        _show_progress(done, options.seeds)
    return _report_of_many(options, campaign, done)


def _show_progress(done: list[BatchResult], wanted: int) -> None:
    seeds = sum(part.seeds for part in done)
    failed = sum(len(part.failed) for part in done)
    print(f"{seeds} of {wanted} seeds, {failed} violate", file=sys.stderr, flush=True)


def _report_of_many(
    options: argparse.Namespace, campaign: Campaign, done: list[BatchResult]
) -> BenchmarkReport:
    failed = [result for part in done for result in part.failed]
    cpu_s, simulated_ns = sum(p.cpu_s for p in done), sum(p.simulated_ns for p in done)
    coverage = Coverage()
    for part in done:
        coverage.add(part.coverage)
    notes = coverage.lines()
    for result in failed[:MAX_SHOWN]:
        notes += explain(result, options, campaign)
    if len(failed) > MAX_SHOWN:
        others = ", ".join(str(result.scenario.seed) for result in failed[MAX_SHOWN:][:50])
        notes.append(f"other seeds that violate: {others}")
    return BenchmarkReport(
        benchmark=campaign.name,
        figures=(
            figure("seeds", sum(part.seeds for part in done)),
            figure(campaign.failure, len(failed), at_most=0),
            figure(
                "simulated time per CPU time of one core",
                simulated_ns / NS_PER_S / cpu_s,
                "x",
                at_least=campaign.pace,
            ),
        ),
        notes=tuple(notes),
    )


def _report_of_one(
    options: argparse.Namespace, campaign: Campaign, result: RunResult
) -> BenchmarkReport:
    failed = result.violation is not None
    figures = [figure("violations", failed, at_most=0)]
    if options.replay == AGAIN:
        same = campaign.run(result.scenario, "").digest == result.digest
        figures.append(figure("runs that differ", not same, at_most=0))
    return BenchmarkReport(
        benchmark=campaign.name,
        figures=tuple(figures),
        notes=(
            f"digest {result.digest} after {result.simulated_ns / NS_PER_S:.2f} s",
            *(explain(result, options, campaign) if failed else ()),
        ),
    )


def _report_of_defects(options: argparse.Namespace, campaign: Campaign) -> BenchmarkReport:
    """Report how many seeds find each defect, and by which invariant."""
    names = options.defects or tuple(campaign.defects)
    figures, notes = [], []
    for name in names:
        hunt = search_defect(name, options.first, campaign=campaign)
        words = "not found"
        if hunt.found is not None and hunt.found.violation is not None:
            words = f"seed {hunt.found.scenario.seed}: «{hunt.found.violation.invariant}»"
        notes.append(f"{name}, {campaign.defects[name].description}: {words}")
        print(f"{hunt.seeds:5} seeds  {notes[-1]}", file=sys.stderr, flush=True)
        seeds = hunt.seeds if hunt.found is not None else MOST_HUNTED + 1
        figures.append(figure(f"seeds until {name} is found", seeds, at_most=MOST_HUNTED))
    return BenchmarkReport(benchmark=campaign.name, figures=tuple(figures), notes=tuple(notes))


def explain(result: RunResult, options: argparse.Namespace, campaign: Campaign) -> list[str]:
    """Return seed, invariant, time, the fewest events, and the command that repeats the run."""
    small = result if options.no_shrink else shrink(result, lambda one: campaign.run(one, ""))
    violation, scenario = small.violation, small.scenario
    assert violation is not None
    if options.events is not None:
        options.events.write_text(to_json(scenario), encoding="utf-8")
    return [
        f"seed {scenario.seed} violates «{violation.invariant}» at "
        f"{violation.time_ns / NS_PER_S:.3f} s: {violation.words}",
        *(f"    {event}" for event in scenario.events),
        f"    again: sidestep bench {campaign.name} --seed {scenario.seed} --replay",
    ]
