"""Studies and searches on clusters, killed, stopped or without room."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from checks.harness.crew import children_of
from checks.harness.until import until
from checks.speed.fleet_cost import HALL
from examples import dask_fleet
from ground.cli.main import main as up
from protocol.world import World
from runtime.errors import RemoteError, UserError
from study.cli.falsify import main
from study.runner import workers as executors
from study.runner.plan import TrialTask
from study.runner.rows import FAILED, TrialRow, code
from study.runner.run_task import StudyContext
from study.runner.store import ASIDE, RESULTS, SHARDS, read
from study.runner.workers import Pool
from study.runner.workers import workers as runner_workers
from tests.support.studies import boxed, context_of, deadly, floor, ids, spoil, tasks


@pytest.fixture(scope="module")
def cluster_address() -> Iterator[str]:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.stack
def test_search_uses_every_thread_of_the_cluster(cluster_address: str) -> None:
    with runner_workers(1, cluster_address) as pool:
        assert pool.threads() == 4
        assert pool.executor.submit(abs, -3).result() == 3


@pytest.mark.stack
def test_fleet_on_a_cluster_drives_as_that_of_one_computer(
    cluster_address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = tmp_path / "hall.toml"
    world.write_text(HALL, encoding="utf-8")
    words = ["--world", str(world), "--robots", "4", "--speed", "max", "--timeout", "2"]
    with executors.cluster(cluster_address) as client:
        _, outcomes = dask_fleet.drive(client, words)
    assert up(["up", "--headless", "--no-record", "--json", *words]) == 1
    alone = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert [one.digest for one in outcomes] == [one["digest"] for one in alone["robots"]]


@pytest.mark.stack
def test_fleet_on_a_cluster_ends_when_a_process_of_it_does(cluster_address: str) -> None:
    def unknown(parts: dask_fleet.Parts, _: str) -> dask_fleet.Parts:
        return [parts[0], [["plant", "--world", "atlantis"]]]

    with (
        executors.cluster(cluster_address) as client,
        pytest.raises(RemoteError, match=r"plant --world atlantis \.\.\. ended with 2"),
    ):
        dask_fleet.drive(client, ["--robots", "2", "--speed", "max"], unknown)


@pytest.mark.stack
def test_findings_on_dask_are_those_of_our_own_processes(
    cluster_address: str, tmp_path: Path
) -> None:
    words = ["vgm", "--properties", "e", "--detour", "1.0001", "--families", "wedge"]
    words += ["--trials", "1", "--vary", "--seed", "1", "--jobs", "1"]
    found = {}
    for name, more in (("dask", ["--dask", cluster_address]), ("ours", [])):
        output = tmp_path / name
        assert main([*words, *more, "--output", str(output)]) == 1
        found[name] = {file.name: file.read_bytes() for file in output.glob("e-*")}
    assert found["dask"] == found["ours"]
    assert len(found["ours"]) == 2


MAX_DEATHS = 1
"""Dask rejects a task after more deaths of its workers; each death costs a start of a worker."""

if TYPE_CHECKING:
    from distributed import LocalCluster


@contextmanager
def local_cluster(workers: int) -> Iterator["LocalCluster"]:
    """Start a scheduler with so many worker processes, which it replaces when they die.

    The nanny of a worker replaces it, but not one that dies while it starts: the cluster does.
    """
    import dask.config
    from distributed import LocalCluster

    settings = {
        "distributed.scheduler.allowed-failures": MAX_DEATHS,
        "distributed.deploy.lost-worker-timeout": "1s",
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0"
        ) as cluster,
    ):
        cluster.adapt(minimum=workers, maximum=workers)
        yield cluster


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with local_cluster(2) as cluster:
        yield cluster.scheduler_address


def run(address: str, made: Sequence[TrialTask], *worlds: World) -> dict[str, TrialRow]:
    with executors.cluster(address) as client:
        return by_trial(executors.run_on_cluster(client, context_of(*worlds), made))


def by_trial(rows: Iterator[TrialRow | None]) -> dict[str, TrialRow]:
    found = [row for row in rows if row is not None]
    assert len({row.trial_id for row in found}) == len(found), "a trial came twice"
    return {row.trial_id: row for row in found}


def digests(rows: dict[str, TrialRow]) -> dict[str, str]:
    return {name: row.digest for name, row in rows.items()}


@pytest.mark.stack
def test_the_rows_are_those_of_our_own_processes(address: str) -> None:
    worlds = (floor(), boxed())
    made = tasks(*worlds, noise=("none", "harsh"), seeds=3)
    with Pool(1, context_of(*worlds)) as pool:
        ours = by_trial(pool.run(made))
    assert digests(run(address, made, *worlds)) == digests(ours)
    assert len(ours) == len(made)


@pytest.mark.stack
def test_trials_outlive_dask_workers_and_one_that_kills_them_has_failed(tmp_path: Path) -> None:
    with local_cluster(2) as cluster:
        address = cluster.scheduler_address
        killed_from_outside_they_cost_no_trial(address)
        one_that_dies_costs_no_trial(address, tmp_path / "once")
        a_trial_that_every_worker_dies_of_has_failed(address, tmp_path / "always")


def one_that_dies_costs_no_trial(address: str, marks: Path) -> None:
    worlds = (floor(), deadly(marks, times=1), boxed())
    made = tasks(*worlds, noise=("default",), seeds=4)
    rows = run(address, made, *worlds)
    assert len(list(marks.iterdir())) == 1
    assert sorted(rows) == sorted(task.trial_id for task in made)
    assert {row.outcome for row in rows.values()} == {"reached"}


def killed_from_outside_they_cost_no_trial(address: str) -> None:
    made = tasks(boxed(), noise=("default",), seeds=12)
    with executors.cluster(address) as client:
        pids = list(client.run(os.getpid).values())
        coming = executors.run_on_cluster(client, context_of(boxed()), made)
        first = next(row for row in coming if row is not None)
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        rows = by_trial(coming)
    assert first.trial_id not in rows
    assert len(rows) == len(made) - 1
    assert {row.outcome for row in rows.values()} == {"reached"}


def a_trial_that_every_worker_dies_of_has_failed(address: str, marks: Path) -> None:
    worlds = (deadly(marks, times=99), floor())
    rows = run(address, tasks(*worlds), *worlds)
    ends = {row.world: row.outcome for row in rows.values()}
    assert ends == {"deadly": FAILED, "floor": "reached"}
    assert any("workers that ran it died" in row.reason for row in rows.values())


@pytest.mark.stack
def test_a_study_on_dask_is_like_any_other(address: str, tmp_path: Path) -> None:
    from study.cli.study import main
    from study.runner.store import read

    words = ["--worlds", "open", "box", "--noise", "none", "--no-report"]
    assert main([*words, "--dask", address, "--output", str(tmp_path / "dask")]) == 0
    assert main([*words, "--jobs", "1", "--output", str(tmp_path / "ours")]) == 0
    one, other = read(tmp_path / "dask"), read(tmp_path / "ours")
    assert one.num_rows == 14
    assert one["trial_id"].equals(other["trial_id"])
    assert one["digest"].equals(other["digest"])


@pytest.mark.stack
def test_other_code_on_the_workers_is_refused(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = code()._replace(digest="other")
    monkeypatch.setattr(executors, "code", lambda: other)
    with pytest.raises(UserError, match="runs other code than this"), executors.cluster(address):
        raise AssertionError("other code was let in")


@pytest.mark.stack
def test_absent_scheduler_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "CONNECT_S", 1.0)
    gone = "tcp://127.0.0.1:1"
    with pytest.raises(UserError, match="no scheduler answers"), executors.cluster(gone):
        raise AssertionError("nobody is there")


@pytest.mark.stack
def test_invalid_address_is_reported() -> None:
    with pytest.raises(UserError, match="--dask"), executors.cluster("no address: at all"):
        raise AssertionError("that is no address")


@pytest.mark.stack
def test_scheduler_without_workers_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "FIRST_WORKER_S", 1.0)
    with (
        local_cluster(0) as cluster,
        pytest.raises(UserError, match="has no workers"),
        executors.cluster(cluster.scheduler_address),
    ):
        raise AssertionError("nobody works there")


@pytest.mark.stack
def test_a_scheduler_that_goes_away_ends_the_study_with_what_is_done() -> None:
    made = tasks(boxed(), noise=("default",), seeds=40)
    with (
        local_cluster(1) as cluster,
        executors.cluster(cluster.scheduler_address) as client,
    ):
        coming = executors.run_on_cluster(client, context_of(boxed()), made)
        assert next(row for row in coming if row is not None).outcome == "reached"
        cluster.close()
        with pytest.raises(UserError, match="finished trials are kept"):
            exhaust(coming)


def exhaust(coming: Iterator[Any]) -> None:
    for _ in coming:
        pass


@pytest.mark.stack
def test_every_task_travels_with_its_own_world_only() -> None:
    sent: list[tuple[TrialTask, StudyContext]] = []

    class Client:
        def submit(self, _: object, task: TrialTask, context: StudyContext, **__: object) -> None:
            sent.append((task, context))

    worlds = (floor(), boxed())
    for task in tasks(*worlds):
        executors._submit(Client(), context_of(*worlds), task)
    assert all(task.place == 0 and len(context.worlds) == 1 for task, context in sent)
    assert {context.worlds[0].name for _, context in sent} == {"floor", "disc"}


ROOT = Path(__file__).parents[2]
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
from sidestep.__main__ import main
from study.runner import conduct

conduct.FLUSH_S = 0.0
write, written = conduct.write_shard, []

def write_and_suspend(*shard):
    written.append(write(*shard))
    if len(written) == {WRITTEN} and os.environ.get("SUSPEND"):
        os.kill(os.getpid(), signal.SIGSTOP)
    return written[-1]

conduct.write_shard = write_and_suspend
sys.exit(main())
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
            until(
                lambda: state_of(process.pid)[0] == "T", within_s=SOON_S, what=f"{WRITTEN} shards"
            )
            yield process
        finally:
            process.kill()
    until(
        lambda: not members(process.pid), within_s=SOON_S, what="workers go when the study is gone"
    )


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
