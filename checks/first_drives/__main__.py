"""Check that first drives beside busy processes arrive, and equal `sidestep trial`.

`python -m checks.first_drives --drives 100 --busy 8` runs `sidestep up` as a new user does:
in each world in turn, without a screen and with the app on a terminal. Each drive must reach its
goal with the digest of the trial, however busy the computer is.
"""

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from threading import Event
from typing import Final

from checks.first_drives.busy import busy, use_normal_priority
from checks.first_drives.drives import WAYS, Drive, Job, driven
from checks.harness.figures import machine_load as machine_load
from plant.world.file import load
from study.trial.trial import Trial, run_trial

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


def jobs_of(drives: int, worlds: Sequence[str], ways: Sequence[str]) -> list[Job]:
    """Return so many jobs, which take the worlds and the ways in turn."""
    kinds = [Job(world, way) for world in worlds for way in ways]
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

    def done(job: Job) -> Drive:
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


def table(drives: Sequence[Drive], trials: dict[str, str], processes: int) -> str:
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


def table_row(world: str, way: str, drives: Sequence[Drive], trials: dict[str, str]) -> str:
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
