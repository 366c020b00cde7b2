"""`sidestep falsify --dask`: all threads of the cluster, and the findings of our own processes."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from study.cli.falsify import main
from study.runner.workers import workers

pytestmark = pytest.mark.stack


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield cluster.scheduler_address


def test_search_uses_every_thread_of_the_cluster(address: str) -> None:
    with workers(1, address) as pool:
        assert pool.threads() == 4
        assert pool.executor.submit(abs, -3).result() == 3


def test_findings_on_dask_are_those_of_our_own_processes(address: str, tmp_path: Path) -> None:
    words = ["vgm", "--properties", "e", "--detour", "1.0001", "--families", "wedge"]
    words += ["--trials", "1", "--vary", "--seed", "1", "--jobs", "1"]
    found = {}
    for name, more in (("dask", ["--dask", address]), ("ours", [])):
        output = tmp_path / name
        assert main([*words, *more, "--output", str(output)]) == 1
        found[name] = {file.name: file.read_bytes() for file in output.glob("e-*")}
    assert found["dask"] == found["ours"]
    assert len(found["ours"]) == 2
