"""The table of benchmarks and their exit codes; no benchmark is run."""

import json
import sys
from argparse import ArgumentParser, Namespace
from types import ModuleType

import pytest

from checks.__main__ import BENCHMARKS, benchmark_of, main
from checks.harness.figures import BenchmarkReport, Figure
from tests.support.each import each


class Stub(ModuleType):
    """A benchmark with a fixed result."""

    def __init__(self, value: float) -> None:
        super().__init__("checks.speed.codec")
        self.value = value

    def add_options(self, parser: ArgumentParser) -> None:
        parser.add_argument("--steps", type=int, default=1)

    def measure(self, options: Namespace) -> BenchmarkReport:
        figure = Figure(name="n", unit="x", values=(self.value * options.steps,), at_least=10.0)
        return BenchmarkReport(benchmark="codec", figures=(figure,))


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    module = Stub(10.0)
    monkeypatch.setitem(sys.modules, "checks.speed.codec", module)
    return module


@each("name", BENCHMARKS)
def test_every_name_in_the_table_is_a_benchmark(name: str) -> None:
    benchmark = benchmark_of([name])
    assert benchmark is not None
    benchmark.add_options(ArgumentParser())
    assert callable(benchmark.measure)


def test_missed_threshold_is_exit_code_1(stub: Stub, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["codec"]) == 0
    stub.value = 9.0
    assert main(["codec"]) == 1
    assert "MISSED" in capsys.readouterr().out


def test_json_contains_the_machine(stub: Stub, capsys: pytest.CaptureFixture[str]) -> None:
    main(["codec", "--json", "--steps", "3"])
    report = json.loads(capsys.readouterr().out)
    assert report["figures"][0]["median"] == 30.0
    assert {"cpu", "cores", "python", "load"} <= set(report["machine"])


@pytest.mark.parametrize("arguments", [[], ["nonsense"], ["codec", "--nonsense"]])
def test_wrong_usage_is_exit_code_2(stub: Stub, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(arguments)
    assert refused.value.code == 2
