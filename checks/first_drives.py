"""Check that first drives beside busy processes arrive, and equal `sidestep trial`.

`python -m checks.first_drives --drives 100 --busy 8` runs `sidestep up` as a new user does: in each
world in turn, without a screen and with the app on a terminal. Each drive must reach its goal with
the digest of the trial, however busy the computer is.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from statistics import median
from threading import Event
from time import monotonic
from typing import Final, NamedTuple

from checks.harness.figures import machine_load
from checks.harness.processes import busy, use_normal_priority
from checks.harness.terminal import Terminal
from ground.launch.child_command import command
from ground.user.runs import Run, read_runs
from plant.world.file import load
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import RUN, STATUS, Role
from protocol.wire.enums import GoalState, RunAction
from protocol.wire.messages import NavigatorStatus, RunRequest, RunScore
from runtime.errors import LocalError, NoAnswerError, RemoteError
from runtime.units import NS_PER_S
from study.trial.trial import Trial, run_trial

WAYS: Final = ("headless", "app")
SIZE: Final = (80, 24)
START_S: Final = 60.0
DRIVE_S: Final = 600.0
ASK_S: Final = 5.0
POLL_S: Final = 0.1
STOPPED: Final = "stopped"


class FirstDriveJob(NamedTuple):
    """A drive to be done: its world, and `headless` or `app`."""

    world: str
    way: str


class FirstDrive(NamedTuple):
    """A drive that was done; `simulated_s` and `wall_s` are 0 without an end of the goal."""

    job: FirstDriveJob
    outcome: str
    digest: str = ""
    simulated_s: float = 0.0
    wall_s: float = 0.0

    @property
    def arrived(self) -> bool:
        """Whether the goal was reached."""
        return self.outcome == GoalState.REACHED.name.lower()

    @property
    def factor(self) -> float:
        """Simulated time over wall time."""
        return self.simulated_s / self.wall_s if self.wall_s else 0.0


def driven(job: FirstDriveJob, stopping: Event) -> FirstDrive:
    """Do one drive in a folder of its own, which is kept when the drive has no outcome."""
    way = {"headless": headless, "app": with_app}[job.way]
    folder = Path(tempfile.mkdtemp(prefix="first-drive-"))
    try:
        drive = way(job, folder, stopping)
    except (LocalError, RemoteError, RuntimeError) as error:
        return FirstDrive(job, f"no outcome: {error}; see {folder}")
    shutil.rmtree(folder)
    return drive


def headless(job: FirstDriveJob, folder: Path, stopping: Event) -> FirstDrive:
    """Drive without a screen, and read the outcome that is printed."""
    words = command(["up", "--headless", "--world", job.world, "--json"], os.getpid())
    environment = {**os.environ, "XDG_STATE_HOME": str(folder)}
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment, text=True,
        start_new_session=True,
    ) as process:  # fmt: skip
        try:
            await_condition(lambda: process.poll() is not None, DRIVE_S, "the end", stopping)
        finally:
            process.terminate()
        assert process.stdout is not None
        found = json.loads(process.stdout.read() or '{"outcome": "no outcome"}')
    if "digest" not in found:
        return FirstDrive(job, str(found.get("reason", found.get("outcome"))))
    return FirstDrive(job, found["outcome"], found["digest"], found["time_s"], found["wall_s"])


def with_app(job: FirstDriveJob, folder: Path, stopping: Event) -> FirstDrive:
    """Drive with the app on a terminal; ask the plant for the score as a second client."""
    environment = {"XDG_STATE_HOME": str(folder)}
    with Terminal(("up", "--world", job.world), SIZE, environment) as terminal:
        runs = folder / "sidestep" / "run"
        try:
            await_condition(partial(has_run, runs), START_S, "a runtime file", stopping)
            return observed(job, read_runs(runs).found[0].run, stopping)
        except Exception:
            (folder / "screen").write_text(terminal.text(), encoding="utf-8")
            raise


def has_run(folder: Path) -> bool:
    """Return whether `up` has written its runtime file."""
    return bool(read_runs(folder).found)


def observed(job: FirstDriveJob, run: Run, stopping: Event) -> FirstDrive:
    """Follow the goal of a run to its end, and ask the plant for the score."""
    network = Network(mode="client", connect=(run.endpoint,), connect_timeout_s=START_S)
    with open_bus(network, Role.GROUND, run.robots[0]) as bus:
        statuses = bus.mailbox(STATUS)
        first: list[tuple[int, int]] = []

        def newest() -> NavigatorStatus | None:
            seen = statuses.latest()
            if seen is not None and not first and seen[0].goal_id:
                first.append((seen[0].time_ns, seen[1]))
            return None if seen is None else seen[0]

        def ended() -> bool:
            status = newest()
            return status is not None and status.goal >= GoalState.REACHED

        await_condition(ended, DRIVE_S, "the end of the goal", stopping)
        seen = statuses.latest()
        assert seen is not None
        status, arrived_ns = seen
        scores: list[RunScore] = []
        ask = partial(ask_score, bus, status.goal_ended_ns, scores)
        await_condition(ask, START_S, "the plant's score", stopping)
    simulated_ns, wall_ns = status.time_ns - first[0][0], arrived_ns - first[0][1]
    return FirstDrive(
        job, GoalState(status.goal).name.lower(), bytes(scores[0].digest).hex(),
        simulated_ns / NS_PER_S, wall_ns / NS_PER_S,
    )  # fmt: skip


def ask_score(bus: Bus, until_ns: int, scores: list[RunScore]) -> bool:
    """Ask the plant for the score; return whether it is now in `scores`."""
    with suppress(NoAnswerError):
        answer = bus.ask(RUN, RunRequest(until_ns=until_ns, action=RunAction.SCORE), ASK_S)
        scores += [answer] if isinstance(answer, RunScore) else []
    return bool(scores)


def await_condition(
    condition: Callable[[], bool], within_s: float, what: str, stopping: Event
) -> None:
    """Wait for a condition; RuntimeError when it does not hold in time or all is to end."""
    deadline_s = monotonic() + within_s
    while not condition():
        if monotonic() > deadline_s:
            raise RuntimeError(f"{what} did not come within {within_s:g} s")
        if stopping.wait(POLL_S):
            raise RuntimeError(STOPPED)


WORLDS: Final = ("box", "u_trap", "forest_dense")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="first_drives", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--drives", type=int, default=6, metavar="N", help="number of drives (6)")
    parser.add_argument("--busy", type=int, default=8, metavar="B", help="busy processes (8)")
    parser.add_argument("--parallel", type=int, default=1, metavar="K", help="at a time (1)")
    parser.add_argument("--worlds", nargs="+", default=WORLDS, metavar="W", help=", ".join(WORLDS))
    parser.add_argument("--ways", nargs="+", default=WAYS, choices=WAYS, help=", ".join(WAYS))
    return parser


def jobs_of(drives: int, worlds: Sequence[str], ways: Sequence[str]) -> list[FirstDriveJob]:
    """Return so many jobs, which take the worlds and the ways in turn."""
    kinds = [FirstDriveJob(world, way) for world in worlds for way in ways]
    return [kinds[number % len(kinds)] for number in range(drives)]


def main(arguments: Sequence[str]) -> int:
    """Run the drives; return 0 if all arrived with the digest of their trial, else 1."""
    options = parser().parse_args(arguments)
    use_normal_priority()
    for number in (signal.SIGINT, signal.SIGTERM):  # a shell ignores SIGINT in the background
        signal.signal(number, signal.default_int_handler)
    trials = {world: run_trial(Trial(world=load(world))).digest for world in options.worlds}
    jobs = jobs_of(options.drives, options.worlds, options.ways)
    stopping = Event()

    def done(job: FirstDriveJob) -> FirstDrive:
        drive = driven(job, stopping)
        verdict = "same digest" if drive.digest == trials[job.world] else "OTHER DIGEST"
        print(
            f"{job.world:<14}{job.way:<10}{drive.outcome:<10} {verdict:<14}"
            f"{drive.factor:5.2f}x{drive.wall_s:7.1f} s  load {machine_load():.1f}",
            flush=True,
        )
        return drive

    with busy(options.busy), ThreadPoolExecutor(options.parallel) as pool:
        try:
            drives = list(pool.map(done, jobs))
        except KeyboardInterrupt:
            stopping.set()
            pool.shutdown(cancel_futures=True)
            print("stopped")
            return 130
    print(table(drives, trials, options.busy))
    right = [drive.arrived and drive.digest == trials[drive.job.world] for drive in drives]
    return 0 if all(right) else 1


def table(drives: Sequence[FirstDrive], trials: dict[str, str], processes: int) -> str:
    """Return a row for each world and way, and one for all."""
    lines = [
        f"{len(drives)} first drives beside {processes} busy processes on "
        f"{len(os.sched_getaffinity(0))} cores, load {machine_load():.1f}",
        f"{'world':<14}{'way':<10}{'arrived':>10}{'digests':>18}{'factor, least':>15}"
        f"{'median':>8}{'wall time':>12}",
    ]
    rows = [
        table_row(*job, [one for one in drives if one.job == job], trials)
        for job in sorted({drive.job for drive in drives})
    ]
    return "\n".join([*lines, *rows, table_row("all", "", drives, trials)])


def table_row(world: str, way: str, drives: Sequence[FirstDrive], trials: dict[str, str]) -> str:
    """Return the row of some drives."""
    equal = sum(drive.digest == trials[drive.job.world] for drive in drives)
    factors = [drive.factor for drive in drives]
    return (
        f"{world:<14}{way:<10}{sum(one.arrived for one in drives):>4} of {len(drives):<3}"
        f"{equal:>5} of {len(drives):<3} equal{min(factors):>12.2f}x{median(factors):>8.2f}x"
        f"{median(drive.wall_s for drive in drives):>10.1f} s"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
