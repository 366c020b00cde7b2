"""`sidestep study` as a process, killed, stopped or without room: no trial is lost or run twice."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from study.runner.store import ASIDE, RESULTS, SHARDS, read
from tests.support.stack.process_table import children_of
from tests.support.study.made import ids, spoil
from tests.support.until import until

ROOT = Path(__file__).parents[3]
WORDS = (
    *("--worlds", "box", "u_trap", "--noise", "default", "harsh"),
    *("--navigators", "vgm", "bug", "--seeds", "2", "--timeout", "10"),
    "--no-report",
)
TRIALS = 2 * 2 * 2 * 2
WRITTEN = 2
"""Shards of one row each that a study writes before it suspends itself."""
SOON_S = 120.0
SIDESTEP = f"""
import os
import signal
import sys
import sidestep
from study.runner import conduct

conduct.FLUSH_S = 0.0
write, written = conduct.write_shard, []

def write_and_suspend(*shard):
    written.append(write(*shard))
    if len(written) == {WRITTEN} and os.environ.get("SUSPEND"):
        os.kill(os.getpid(), signal.SIGSTOP)
    return written[-1]

conduct.write_shard = write_and_suspend
sys.exit(sidestep.main())
"""
"""Every row is written at once, and the study cannot end before the test acts."""


def command(place: Path, *more: str, jobs: int = 1) -> list[str]:
    words = ("study", *WORDS, "--jobs", str(jobs), "--output", str(place), *more)
    return [sys.executable, "-c", SIDESTEP, *words]


@contextmanager
def suspended(
    place: Path, limits: Callable[[], None] | None = None, jobs: int = 1
) -> Iterator["subprocess.Popen[str]"]:
    """Start a study in its own process group until it has written; end all of it afterwards."""
    with subprocess.Popen(
        command(place, jobs=jobs),
        cwd=ROOT,
        env={**os.environ, "SUSPEND": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=limits,
    ) as process:
        try:
            until(lambda: state_of(process.pid)[0] == "T", SOON_S, f"{WRITTEN} shards")
            yield process
        finally:
            process.kill()
    until(lambda: not members(process.pid), SOON_S, "workers go when the study is gone")


def state_of(pid: int | str) -> tuple[str, int]:
    """Return the state of a process and its group; that of a zombie when it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return fields[0], int(fields[2])
    except (OSError, IndexError):
        return "Z", 0


def members(group: int) -> list[str]:
    """Return the processes of a group that still run."""
    pids = [entry.name for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    states = {pid: state_of(pid) for pid in pids}
    return [pid for pid, (state, its) in states.items() if its == group and state != "Z"]


def workers(process: "subprocess.Popen[str]") -> list[int]:
    """Return the spawned processes that run trials, without the resource tracker.

    Only children count: a program that a worker starts has the worker's arguments at first.
    """
    return [pid for pid in children_of(process.pid) if b"spawn_main" in arguments(pid)]


def arguments(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def shards(place: Path) -> list[Path]:
    return sorted((place / SHARDS).glob("*.parquet"))


def finish(place: Path, python: str = sys.executable) -> Any:
    """Run the rest of the study; return its summary."""
    words = [python, *command(place, "--json")[1:]]
    run = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return studies without interruption by one worker, of every Python that can run them."""
    places = []
    for python in (sys.executable, *others()):
        places.append(tmp_path_factory.mktemp("undisturbed"))
        summary = finish(places[-1], python)
        assert summary["run_now"] == summary["trials"] == TRIALS
    return places


def same(place: Path, undisturbed: list[Path]) -> None:
    found = read(place)
    for expected in map(read, undisturbed):
        assert ids(found) == ids(expected)
        assert found["digest"].equals(expected["digest"])


def test_interrupted_study_loses_and_repeats_no_trial(
    tmp_path: Path, undisturbed: list[Path]
) -> None:
    with suspended(tmp_path) as process:
        second_is_refused(tmp_path)
        assert state_of(process.pid)[0] == "T"
        process.kill()
        process.wait()
    assert read(tmp_path).num_rows == WRITTEN
    with suspended(tmp_path) as process:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert read(tmp_path).num_rows == 2 * WRITTEN
    # As a terminal does, which reaches the workers, too.
    stopped(tmp_path, lambda process: os.killpg(process.pid, signal.SIGINT), jobs=2)
    bad = shards(tmp_path)[0]
    spoil(bad)
    told = stopped(tmp_path, lambda process: process.send_signal(signal.SIGTERM))
    assert f"{bad}: cannot be read" in told
    assert (tmp_path / ASIDE / bad.name).exists()
    without_room_and_workers(tmp_path, (undisturbed[0] / RESULTS).stat().st_size)
    rows = read(tmp_path)
    assert rows.num_rows == TRIALS
    assert "failed" not in set(rows["outcome"].to_pylist())
    assert finish(tmp_path)["run_now"] == 0
    same(tmp_path, undisturbed)


def second_is_refused(place: Path) -> None:
    second = subprocess.run(command(place), cwd=ROOT, capture_output=True, text=True, check=False)
    assert second.returncode == 2
    assert "another study is writing there" in second.stderr


def stopped(place: Path, stop: Callable[["subprocess.Popen[str]"], None], jobs: int = 1) -> str:
    """Stop a study by a signal; return its messages."""
    with suspended(place, jobs=jobs) as process:
        assert len(workers(process)) == jobs
        stop(process)
        process.send_signal(signal.SIGCONT)
        _, told = process.communicate(timeout=SOON_S)
        assert process.returncode == 130
    assert "Traceback" not in told
    kept = read(place).num_rows  # a row that was written twice counts once
    assert kept < TRIALS
    assert f"stopped; {kept} of {TRIALS} trials are in {place}" in told
    assert f"sidestep study {' '.join(WORDS)}" in told
    return told


def without_room_and_workers(place: Path, results_size: int) -> None:
    """Kill the workers of a study that has room for shards, but not for the file of results."""
    limit = (max(file.stat().st_size for file in shards(place)) + results_size) // 2

    def little_room() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    with suspended(place, little_room, jobs=2) as process:
        assert len(workers(process)) == 2
        for pid in workers(process):
            os.kill(pid, signal.SIGKILL)
        process.send_signal(signal.SIGCONT)
        _, told = process.communicate(timeout=SOON_S)
        assert process.returncode == 2
    assert "Traceback" not in told
    assert f"{RESULTS}: cannot be written: File too large" in told
    assert "free disk space and run the same command again" in told
    assert shards(place)


def others() -> list[str]:
    """Pythons of other versions that can run a study."""
    mine = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    names = [name for name in ("python3.11", "python3.12", "python3.13") if name != mine]
    found = [path for path in map(shutil.which, names) if path is not None]
    needs = "import numpy, pymunk, msgspec, pyarrow, fastcrc"
    return [
        path
        for path in found
        if subprocess.run([path, "-c", needs], capture_output=True, check=False).returncode == 0
    ]
