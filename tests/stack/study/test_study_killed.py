"""`sidestep study` as a process, killed, stopped or without room: no trial is lost or run twice."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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
    *("--navigators", "vgm", "bug", "--seeds", "3", "--timeout", "30"),
    *("--no-report", "--jobs", "2"),
)
TRIALS = 2 * 2 * 2 * 3
SOON_S = 120.0
SIDESTEP = """
import sys
import sidestep
from study.runner import conduct
conduct.FLUSH_S = 0.0
sys.exit(sidestep.main())
"""
"""Every row is written at once, so that few trials make many shards."""


def command(place: Path, *more: str) -> list[str]:
    return [sys.executable, "-c", SIDESTEP, "study", *WORDS, "--output", str(place), *more]


@contextmanager
def begun(
    place: Path, limits: Callable[[], None] | None = None
) -> Iterator["subprocess.Popen[str]"]:
    """Start a study in its own process group; end all of it afterwards."""
    with subprocess.Popen(
        command(place),
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=limits,
    ) as process:
        try:
            yield process
        finally:
            process.kill()
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGCONT)
    until(lambda: not members(process.pid), SOON_S, "workers go when the study is gone")


def members(group: int) -> list[int]:
    """Return the processes of a group that still run."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, _, its_group = (entry / "stat").read_text().rpartition(")")[2].split()[:3]
            except (OSError, ValueError):
                continue
            if int(its_group) == group and state != "Z":
                found.append(int(entry.name))
    return found


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


def shards(place: Path) -> int:
    return len(list((place / SHARDS).glob("*.parquet")))


def underway(process: "subprocess.Popen[str]", place: Path, number: int = 1) -> None:
    """Wait for shards, and suspend the workers: the study cannot end before the test acts."""
    until(lambda: shards(place) >= number, SOON_S, f"{number} shards")
    for pid in workers(process):
        os.kill(pid, signal.SIGSTOP)
    assert process.poll() is None


def finish(place: Path, *more: str) -> tuple[Any, str]:
    """Run the rest of the study; return its summary and its messages."""
    run = subprocess.run(
        command(place, "--json", *more), cwd=ROOT, capture_output=True, text=True, check=True
    )
    return json.loads(run.stdout), run.stderr


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the results of the study without interruption."""
    place = tmp_path_factory.mktemp("undisturbed")
    summary, _ = finish(place)
    assert summary["run_now"] == summary["trials"] == TRIALS
    return read(place)


def same(place: Path, undisturbed: Any) -> None:
    found = read(place)
    assert ids(found) == ids(undisturbed)
    assert found["digest"].equals(undisturbed["digest"])


def test_killed_twice_it_goes_on_where_it_was(tmp_path: Path, undisturbed: Any) -> None:
    done = 0
    for _ in range(2):
        before = shards(tmp_path)
        with begun(tmp_path) as process:
            underway(process, tmp_path, before + 1)
            process.kill()
            process.wait()
        assert read(tmp_path).num_rows > done
        done = read(tmp_path).num_rows
    summary, _ = finish(tmp_path)
    assert summary["run_now"] == TRIALS - done
    same(tmp_path, undisturbed)


def test_its_workers_killed_it_goes_on_with_others(tmp_path: Path, undisturbed: Any) -> None:
    with begun(tmp_path) as process:
        until(lambda: len(workers(process)) == 2, SOON_S, "two workers")
        underway(process, tmp_path)
        for pid in workers(process):
            os.kill(pid, signal.SIGKILL)
        assert process.wait(SOON_S) == 0
    same(tmp_path, undisturbed)
    assert "failed" not in set(read(tmp_path)["outcome"].to_pylist())


def test_all_of_it_killed_at_once_loses_only_what_was_not_yet_written(
    tmp_path: Path, undisturbed: Any
) -> None:
    with begun(tmp_path) as process:
        underway(process, tmp_path)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    kept = read(tmp_path).num_rows
    assert 0 < kept < TRIALS
    summary, _ = finish(tmp_path)
    assert summary["run_now"] == TRIALS - kept
    same(tmp_path, undisturbed)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_stopped_study_keeps_its_rows_and_can_continue(
    tmp_path: Path, undisturbed: Any, number: signal.Signals
) -> None:
    with begun(tmp_path) as process:
        until(lambda: len(workers(process)) == 2, SOON_S, "two workers")
        underway(process, tmp_path)
        if number == signal.SIGINT:
            os.killpg(process.pid, number)  # as a terminal does
        else:
            process.send_signal(number)
        _, told = process.communicate(timeout=SOON_S)
        assert process.returncode == 130
    assert "Traceback" not in told
    assert f"of {TRIALS} trials are in {tmp_path}" in told
    assert f"sidestep study {' '.join(WORDS)}" in told
    kept = read(tmp_path).num_rows
    assert f"stopped; {kept} of" in told
    summary, _ = finish(tmp_path)
    assert summary["run_now"] == TRIALS - kept
    same(tmp_path, undisturbed)


def test_without_room_it_ends_clearly_and_loses_nothing_written(
    tmp_path: Path, undisturbed: Any
) -> None:
    def little_room() -> None:
        """Allow a shard of few rows, but not the file of all results."""
        resource.setrlimit(resource.RLIMIT_FSIZE, (24_000, 24_000))

    with begun(tmp_path, little_room) as process:
        _, told = process.communicate(timeout=SOON_S)
        assert process.returncode == 2
    assert "Traceback" not in told
    assert "cannot be written: File too large" in told
    assert "free disk space and run the same command again" in told
    assert shards(tmp_path) > 0
    finish(tmp_path)
    same(tmp_path, undisturbed)


def test_a_shard_spoilt_meanwhile_is_set_aside_and_run_again(
    tmp_path: Path, undisturbed: Any
) -> None:
    with begun(tmp_path) as process:
        underway(process, tmp_path, 2)
        process.kill()
        process.wait()
    bad = min((tmp_path / SHARDS).glob("*.parquet"))
    spoil(bad)
    _, told = finish(tmp_path)
    assert f"{bad}: cannot be read" in told
    assert (tmp_path / ASIDE / bad.name).exists()
    same(tmp_path, undisturbed)


def test_two_studies_in_one_place_do_not_mix(tmp_path: Path) -> None:
    with begun(tmp_path) as process:
        underway(process, tmp_path)
        second = subprocess.run(
            command(tmp_path), cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert second.returncode == 2
        assert "another study is writing there" in second.stderr
        assert process.poll() is None


def test_another_process_and_another_python_give_the_same_digests(
    tmp_path: Path, undisturbed: Any
) -> None:
    """Run a new process of this Python, and of every other one here with the packages."""
    tried = []
    for python in (sys.executable, *others()):
        place = tmp_path / Path(python).name
        words = command(place)[1:]
        words[words.index("--jobs") + 1] = "3"
        subprocess.run([python, *words], cwd=ROOT, capture_output=True, check=True)
        same(place, undisturbed)
        tried.append(python)
    assert tried
    assert (tmp_path / Path(sys.executable).name / RESULTS).exists()


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
