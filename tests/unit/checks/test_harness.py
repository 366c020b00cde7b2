"""What tests and checks share: figures, motion, the relay, builds, and the hooks of pytest."""

import asyncio
import json
import os
import re
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from itertools import pairwise
from pathlib import Path
from threading import Thread
from time import monotonic, time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checks import built as cache
from checks.built import ROOT, BuildError, built, environment, key_of, node_modules
from checks.harness import observer as motion
from checks.harness.figures import BenchmarkReport, Figure, digits, percentile, ratios
from checks.harness.loop import PlayedLoop
from checks.harness.messages import make
from checks.harness.observer import HOLDS, Seen
from checks.harness.relays import (
    OVERTAKEN_NS,
    PERFECT,
    POOR,
    ImpairedLine,
    Impairment,
    TcpProxy,
    UdpRelay,
)
from checks.simulation.hosts.virtual_time import Host, Scheduler, SimulatedLoop
from protocol.wire.messages import GroundTruth
from runtime.clock import ManualClock
from runtime.units import NS_PER_MS
from tests.support.each import each

finite = st.floats(-1e9, 1e9)


def figure(*values: float, least: float | None = None, most: float | None = None) -> Figure:
    return Figure(name="speed", unit="x", values=values, at_least=least, at_most=most)


def test_single_good_repetition_does_not_meet_threshold() -> None:
    assert figure(390.0, 395.0, 900.0, least=400.0).met is False
    assert figure(390.0, 405.0, 410.0, least=400.0).met is True


def test_upper_limit_is_met_at_its_value() -> None:
    assert figure(2.0, most=2.0).met is True
    assert figure(2.1, most=2.0).met is False


def test_figure_without_threshold_has_no_verdict() -> None:
    assert figure(1.0).met is None
    assert "met" not in figure(1.0).line()
    assert "MISSED" not in figure(1.0).line()


def test_proxy_delays_each_way_and_passes_the_end() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with (
            TcpProxy(f"tcp/127.0.0.1:{port}", delay_s=0.02) as proxy,
            socket.create_connection(("127.0.0.1", int(proxy.endpoint.rpartition(":")[2]))) as near,
        ):
            far, _ = server.accept()
            with far:
                began_s = monotonic()
                near.sendall(b"to")
                assert far.recv(9) == b"to"
                far.sendall(b"fro")
                assert near.recv(9) == b"fro"
                assert monotonic() - began_s >= 0.04
                near.shutdown(socket.SHUT_WR)
                assert far.recv(9) == b""


def test_missed_figure_shows_spread_and_threshold() -> None:
    line = figure(1.0, 2.0, 3.0, least=5.0).line()
    assert "MISSED" in line
    assert "(1 to 3, 3 times)" in line
    assert ">= 5" in line


def test_missing_values_are_an_error() -> None:
    with pytest.raises(ValueError, match="nothing was measured"):
        figure()
    with pytest.raises(ValueError, match="no values"):
        percentile([], 0.5)


def test_report_is_met_if_every_figure_is() -> None:
    good, bad, free = figure(1.0, most=2.0), figure(3.0, most=2.0), figure(9.0)
    assert BenchmarkReport(benchmark="b", figures=(good, free)).met
    assert not BenchmarkReport(benchmark="b", figures=(good, bad)).met


def test_report_is_written_as_json() -> None:
    report = BenchmarkReport(
        benchmark="b", figures=(figure(1.0),), notes=("n",), machine={"cores": 2}
    )
    read = json.loads(json.dumps(report.as_json()))
    assert read["figures"][0]["median"] == 1.0
    assert read["met"] is True
    assert "cores 2" in report.text()
    assert "note: n" in report.text()


def test_report_of_parts_keeps_their_order() -> None:
    first, second = (Figure(name=name, unit="ms", values=(1.0,)) for name in ("first", "second"))
    report = BenchmarkReport.of("two", [([first], ["note"]), ([second], [])])
    assert report == BenchmarkReport(benchmark="two", figures=(first, second), notes=("note",))


def test_percentiles_are_measured_values() -> None:
    values = [float(v) for v in range(1, 101)]
    assert percentile(values, 0.5) == 50.0
    assert percentile(values, 0.99) == 99.0
    assert percentile(values, 1.0) == 100.0
    assert percentile([7.0], 0.0) == 7.0


@given(st.lists(finite, min_size=1), st.floats(0.0, 1.0))
def test_percentile_is_not_exceeded_by_its_share(values: list[float], share: float) -> None:
    limit = percentile(values, share)
    assert limit in values
    assert sum(value <= limit for value in values) >= share * len(values) - 1e-6


def test_ratios_divide_pair_by_pair() -> None:
    assert ratios([4.0, 9.0], [2.0, 3.0]) == (2.0, 3.0)
    with pytest.raises(ValueError, match="longer"):
        ratios([1.0], [1.0, 2.0])


@each(
    ("value", "text"), [(0.0, "0"), (0.012345, "0.01235"), (123.456, "123.5"), (12345.6, "12346")]
)
def test_figures_have_four_digits(value: float, text: str) -> None:
    assert digits(value) == text


def seen(*speeds_m_s: float, touching: tuple[int, ...] = ()) -> list[Seen]:
    """Return one state per period; each speed is that of the period before it."""
    x_m, found = 0.0, []
    for number, speed_m_s in enumerate(speeds_m_s):
        x_m += speed_m_s * 0.05 if number else 0.0
        truth = make(
            GroundTruth,
            time_ns=number * 50_000_000,
            seq=number,
            x_m=x_m,
            speed_m_s=speed_m_s,
            clearance_m=1.0,
            contact=int(number in touching),
        )
        found.append(Seen(number * 0.05, truth))
    return found


AT_REST = (0.0,) * HOLDS


def test_robot_stops_at_begin_of_first_period_without_motion() -> None:
    assert motion.stood_s(seen(0.3, 0.3, 0.1, *AT_REST)) == pytest.approx(0.10)
    assert motion.stood_s(seen(0.3, *AT_REST)) == 0.0


def test_short_rest_is_no_stop() -> None:
    short = seen(0.3, *AT_REST[:-1], 0.1)
    assert motion.stood_s(short) is None
    assert motion.stood_s(seen(0.3, 0.0, 0.1, *AT_REST)) == pytest.approx(0.10)


def test_path_ends_where_the_robot_stops() -> None:
    assert motion.distance_m(seen(0.3, 0.3, 0.1, *AT_REST, 0.3)) == pytest.approx(0.02)
    assert motion.distance_m(seen(0.3, 0.3, 0.3)) == pytest.approx(0.03)


def test_motion_after_a_stop_is_detected() -> None:
    assert motion.moved_again(seen(0.3, *AT_REST, 0.1))
    assert not motion.moved_again(seen(0.3, *AT_REST, 0.0))
    assert not motion.moved_again(seen(0.3, 0.3))


def test_lasting_contact_counts_once() -> None:
    assert motion.contacts(seen(0.3, 0.3, 0.3, 0.3, touching=(1, 2))) == 1
    assert motion.contacts(seen(0.3, 0.3, 0.3, 0.3, touching=(0, 2))) == 2


def test_time_from_contact_to_stop() -> None:
    touched = seen(0.3, 0.3, 0.2, *AT_REST, touching=(1,))
    assert motion.touched_s(touched) == pytest.approx(0.05)
    assert motion.touched_s(seen(0.3, *AT_REST)) is None
    assert motion.touched_s(seen(0.3, 0.3, 0.3, touching=(1,))) is None


COUNT = 2000
FAR_NS = 1 << 62


def arrivals(line: ImpairedLine, count: int = COUNT) -> list[int]:
    """Send numbered datagrams, one per millisecond; return the numbers that arrive."""
    for number in range(count):
        line.put(str(number).encode(), number * NS_PER_MS)
    return [int(data) for data in line.take(FAR_NS)]


def overtaken(numbers: Sequence[int]) -> int:
    return sum(later < earlier for earlier, later in pairwise(numbers))


def test_perfect_line_passes_everything_at_once_in_order() -> None:
    line = ImpairedLine(PERFECT, seed=1)
    line.put(b"a", 5)
    line.put(b"b", 5)
    assert line.take(5) == [b"a", b"b"]
    assert line.due_ns is None
    assert (line.passed, line.lost) == (2, 0)


def test_loss_is_the_share_that_was_asked_for() -> None:
    line = ImpairedLine(Impairment(loss=0.2), seed=1)
    found = arrivals(line)
    assert 0.17 * COUNT < line.lost < 0.23 * COUNT
    assert line.passed == len(found) == COUNT - line.lost


def test_datagram_arrives_after_the_delay_and_not_before() -> None:
    line = ImpairedLine(Impairment(delay_ns=50), seed=1)
    line.put(b"a", 100)
    assert line.due_ns == 150
    assert line.take(149) == []
    assert line.take(150) == [b"a"]


def test_jitter_changes_delays_but_not_the_order() -> None:
    line = ImpairedLine(Impairment(jitter_ns=20 * NS_PER_MS), seed=1)
    assert arrivals(line) == list(range(COUNT))


def test_jitter_stays_within_its_bound() -> None:
    due = set()
    for seed in range(200):
        line = ImpairedLine(Impairment(delay_ns=50, jitter_ns=20), seed)
        line.put(b"a", 0)
        assert line.due_ns is not None
        due.add(line.due_ns)
    assert 50 <= min(due) < 55
    assert 65 < max(due) <= 70


def test_reordered_datagrams_arrive_after_later_ones() -> None:
    line = ImpairedLine(Impairment(reordered=0.1), seed=1)
    found = arrivals(line)
    assert sorted(found) == list(range(COUNT))
    assert 0.07 * COUNT < overtaken(found) < 0.13 * COUNT
    places = {number: place for place, number in enumerate(found)}
    late_ms = OVERTAKEN_NS // NS_PER_MS
    assert max(places[number] - number for number in found) <= late_ms


def test_same_seed_has_the_same_fate_and_another_seed_another() -> None:
    first, again, other = (arrivals(ImpairedLine(POOR, seed)) for seed in (7, 7, 8))
    assert first == again
    assert first != other


def test_another_property_does_not_change_which_are_lost() -> None:
    lossy = arrivals(ImpairedLine(Impairment(loss=0.2), seed=3))
    reordered = arrivals(ImpairedLine(Impairment(loss=0.2, reordered=0.5), seed=3))
    assert lossy == sorted(reordered)


def test_relay_forwards_both_ways_for_several_clients() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        server.bind(("127.0.0.1", 0))
        for end in (server, one, other):
            end.settimeout(20.0)
        with UdpRelay(server.getsockname(), PERFECT, seed=1) as relay:
            for client in (one, other):
                client.connect(("127.0.0.1", relay.port))
                client.send(b"question")
                question, address = server.recvfrom(100)
                server.sendto(question + b" answered", address)
                assert client.recv(100) == b"question answered"
            assert len(relay.peers) == 2


MakesCounted = tuple[list[Path], Callable[[Path], None]]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Redirect the cache to a folder of this test; return that of the kind `thing`."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "sidestep" / "built" / "thing"


@pytest.fixture
def making() -> MakesCounted:
    """Return the places that were filled, and the function that fills one."""
    made: list[Path] = []

    def make(place: Path) -> None:
        made.append(place)
        (place / "folder").mkdir()
        (place / "folder" / "result").write_text("42")

    return made, make


@pytest.mark.usefixtures("home")
def test_entry_is_made_once_for_a_key(making: MakesCounted) -> None:
    made, make = making
    first, again = built("thing", "a", make), built("thing", "a", make)
    assert first == again
    assert (first / "folder" / "result").read_text() == "42"
    assert len(made) == 1
    built("thing", "b", make)
    assert len(made) == 2


@pytest.mark.usefixtures("home")
def test_workers_wait_for_the_one_that_makes(making: MakesCounted) -> None:
    made, make = making
    workers = [Thread(target=built, args=("thing", "a", make)) for _ in range(6)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(made) == 1


@pytest.mark.usefixtures("home")
@pytest.mark.parametrize("damage", [Path.unlink, lambda path: path.write_text("4")])
def test_damaged_entry_is_made_again(
    making: MakesCounted, damage: Callable[[Path], object]
) -> None:
    made, make = making
    damage(built("thing", "a", make) / "folder" / "result")
    assert (built("thing", "a", make) / "folder" / "result").read_text() == "42"
    assert len(made) == 2


@pytest.mark.usefixtures("home")
def test_failed_or_interrupted_build_leaves_no_entry(home: Path, making: MakesCounted) -> None:
    def fail(place: Path) -> None:
        (place / "half").touch()
        raise BuildError("no compiler")

    with pytest.raises(BuildError, match="no compiler"):
        built("thing", "a", fail)
    (home / "unfinished-1").mkdir()  # of a process that was killed
    built("thing", "a", making[1])
    assert sorted(path.name for path in home.iterdir()) == ["a", "lock"]


@pytest.mark.usefixtures("home")
def test_oldest_entries_are_removed_but_none_in_use(home: Path, making: MakesCounted) -> None:
    _, make = making
    for age, key in enumerate("abcdef"):
        entry = built("thing", key, make)
        used = time() - cache.IN_USE_S * (10 - age)
        os.utime(entry / cache.LISTED, (used, used))
    built("thing", "b", make)  # used now
    built("thing", "g", make)
    assert sorted(path.name for path in home.iterdir() if path.is_dir()) == ["b", "e", "f", "g"]


@pytest.mark.usefixtures("home")
def test_key_depends_on_contents_and_facts_only() -> None:
    files = [ROOT / "pyproject.toml", ROOT / "README.md"]
    assert key_of(files, "gcc 12") == key_of(reversed(files), "gcc 12")
    others = {key_of(files, "gcc 12"), key_of(files, "gcc 13"), key_of(files[:1], "gcc 12")}
    assert len(others) == 3


@pytest.mark.usefixtures("home")
def test_failed_installation_of_a_client_says_why() -> None:
    with pytest.raises(BuildError, match=r"pip .*: .*none-of-this-name"):
        environment("none", ["./none-of-this-name"])


NPM = """\
#!/bin/sh
# As `npm pack --silent --pack-destination PLACE NAME@VERSION ...`.
[ "$1 $2 $3" = "pack --silent --pack-destination" ] || { echo "no such options: $*"; exit 1; }
place=$4
shift 4
for pin; do
    case $pin in *none*) echo "404 Not Found: $pin"; exit 1;; esac
    mkdir -p "$place/made/package"
    echo "$pin" >"$place/made/package/index.js"
    file=$(echo "$pin" | sed 's|^@||; s|/|-|g; s|@|-|').tgz
    tar -C "$place/made" -czf "$place/$file" package
done
"""


@pytest.fixture
def npm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put a program before `npm` that packs a file with the name of each package."""
    program = tmp_path / "programs" / "npm"
    program.parent.mkdir()
    program.write_text(NPM)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    return program


@pytest.mark.usefixtures("home", "npm")
def test_packages_of_npm_lie_where_node_finds_them() -> None:
    place = node_modules("some", ["serial@1.2.0", "@scope/stream@3.0.1-b"])
    assert place.name == "node_modules"
    found = {str(file.parent.relative_to(place)): file.read_text() for file in place.rglob("*.js")}
    assert found == {
        "serial": "serial@1.2.0\n",
        "@scope/stream": "@scope/stream@3.0.1-b\n",
    }
    assert sorted(path.name for path in place.parent.iterdir() if path.is_dir()) == [place.name]


@pytest.mark.usefixtures("home")
def test_packages_of_npm_that_are_missing_say_why(npm: Path) -> None:
    with pytest.raises(BuildError, match=r"pack .*none@1: 404 Not Found: none@1"):
        node_modules("some", ["serial@1.2.0", "none@1"])
    npm.unlink()
    with pytest.MonkeyPatch.context() as bare:
        bare.setenv("PATH", str(npm.parent))
        with pytest.raises(BuildError, match="npm is not installed"):
            node_modules("some", ["serial@1.2.0"])


@pytest.mark.usefixtures("home")
def test_read_only_cache_is_replaced_by_a_temporary_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cache.cache() == tmp_path / f"sidestep-built-{os.getuid()}"


pytest_plugins = ["pytester"]

GO_ON = "--continue-on-collection-errors"
PASSES = "def test_passes():\n    pass\n"
SKIPS = "import pytest\n@pytest.mark.skipif(True, reason='no such tool')\ndef test_s():\n    pass\n"
SKIPS_INSIDE = "import pytest\ndef test_s():\n    pytest.skip('no such tool')\n"
MODULE_SKIPS = "import pytest\npytest.skip('no such tool', allow_module_level=True)\n"
EXPECTED_FAILURE = (
    "import pytest\n@pytest.mark.xfail(reason='known')\ndef test_x():\n    raise ValueError\n"
)


def run_pytest(pytester: pytest.Pytester, sources: list[str], *options: str) -> pytest.RunResult:
    """Run pytest within this process, with the hooks of all tests."""
    pytester.makepyfile(**{f"test_{number}": source for number, source in enumerate(sources)})
    settings = pytester.makeini(
        "[pytest]\nmarkers =\n    realtime: alone\n    sweep(n): thinned out\n"
    )
    words = ("-q", "-p", "no:cacheprovider", "-p", "tests.conftest", "-c", str(settings))
    return pytester.runpytest_inprocess(*words, *options)


@pytest.fixture
def _whole_reasons(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let pytest shorten no line of its summary to the width of a terminal."""
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture
def _kept_profile() -> Iterator[None]:
    """Restore the profile of Hypothesis, which the inner run sets for the whole process."""
    before = settings.get_current_profile_name()
    yield
    settings.load_profile(before)


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
def test_skip_fails_the_run_in_ci_with_the_reason(pytester: pytest.Pytester) -> None:
    run = run_pytest(pytester, [SKIPS, SKIPS_INSIDE, MODULE_SKIPS, PASSES], "--no-skips", GO_ON)
    assert run.ret != 0
    summary = run.stdout.str().partition("short test summary")[2]
    for number in range(3):
        assert re.search(rf"test_{number}\.py.* - .*--no-skips forbids: .*no such tool", summary), (
            run.stdout.str()
        )
    assert "test_3" not in summary


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
def test_elsewhere_a_skip_is_only_reported(pytester: pytest.Pytester) -> None:
    assert run_pytest(pytester, [PASSES + SKIPS]).ret == 0


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
def test_passing_and_expected_failing_tests_are_unchanged(pytester: pytest.Pytester) -> None:
    assert run_pytest(pytester, [PASSES + EXPECTED_FAILURE], "--no-skips").ret == 0


TABLE = """
import pytest
from tests.support.each import each

@each("text, length", [("a", 1), ("bb", 3), ("ccc", 4)])
def test_lengths(text, length, tmp_path):
    assert len(text) == length

@each("first", [1, 2])
@each("second", [1, 2])
def test_combinations(first, second):
    assert first + second < 4

@each("tool", ["there", "missing"])
def test_tools(tool):
    if tool == "missing":
        pytest.skip("no such tool")
"""
SWEEP = """
import pytest

@pytest.mark.sweep(3)
@pytest.mark.parametrize("row", range(7))
def test_row(row):
    pass

@pytest.mark.realtime
def test_other():
    pass
"""


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
def test_each_row_that_fails_is_reported_with_its_values(pytester: pytest.Pytester) -> None:
    run = run_pytest(pytester, [TABLE])
    assert run.ret == pytest.ExitCode.TESTS_FAILED
    shown = run.stdout.str().partition("short test summary")[2]
    failed = re.findall(r"SUBFAILED\[(.*?)\] \S+::(\w+)", shown)
    assert failed == [
        ("text='bb', length=3", "test_lengths"),
        ("text='ccc', length=4", "test_lengths"),
        ("first=2, second=2", "test_combinations"),
    ]


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
def test_row_that_is_skipped_fails_in_ci(pytester: pytest.Pytester) -> None:
    run = run_pytest(pytester, [TABLE], "--no-skips", "-k", "test_tools")
    assert run.ret == pytest.ExitCode.TESTS_FAILED
    assert "--no-skips forbids: Skipped: no such tool" in run.stdout.str()


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
def test_table_that_cannot_fail_or_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="no rows for text"):
        each("text", [])
    with pytest.raises(ValueError, match="3 values for text, length: "):
        each("text, length", [("a", 1, 2)])


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
@each(("examples", "passed"), [("brief", 4), ("long", 8)])
def test_sweep_is_whole_only_with_many_examples(
    examples: str, passed: int, pytester: pytest.Pytester
) -> None:
    run = run_pytest(pytester, [SWEEP], "--examples", examples)
    assert run.parseoutcomes()["passed"] == passed


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
def test_tests_of_real_time_report_the_load(pytester: pytest.Pytester) -> None:
    shown = run_pytest(pytester, [SWEEP]).stdout.str()
    assert re.search(
        r"load average met by tests of real time: [\d.]+ to [\d.]+ on \d+ cores", shown
    )


@pytest.mark.usefixtures("_kept_profile")
@pytest.mark.usefixtures("_whole_reasons")
def test_finished_tests_are_counted_for_the_gate(
    pytester: pytest.Pytester, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = tmp_path / "count"
    monkeypatch.setenv("SIDESTEP_TEST_COUNT", str(count))
    run_pytest(pytester, [SWEEP])
    assert count.read_text() == "4 4\n"
    assert "SIDESTEP_TEST_COUNT" not in os.environ, "a pytest that a test starts must not count"


@pytest.fixture
def loops() -> Iterator[tuple[ManualClock, PlayedLoop, PlayedLoop]]:
    clock = ManualClock(7_000_000_000_001)
    with closing(PlayedLoop(clock)) as one, closing(PlayedLoop(clock)) as other:
        yield clock, one, other


Loops = tuple[ManualClock, PlayedLoop, PlayedLoop]


def test_waits_in_a_played_loop_move_only_its_clock(loops: Loops) -> None:
    clock, loop, _ = loops
    began_ns = clock.now_ns()

    async def program() -> str:
        await asyncio.sleep(3600.0)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.Event().wait(), 60.0)
        return await asyncio.to_thread(str.upper, "done")

    assert loop.run(program()) == "DONE"
    assert 0 <= clock.now_ns() - began_ns - 3660 * 10**9 < 1000


def test_time_is_advanced_exactly_and_runs_what_is_due(loops: Loops) -> None:
    clock, loop, _ = loops
    began_ns, seen = clock.now_ns(), list[int]()

    def tick() -> None:
        seen.append(clock.now_ns() - began_ns)
        loop.call_soon(seen.append, -1)
        loop.call_later(0.02, tick)

    loop.call_soon_threadsafe(tick)
    for _ in range(3):
        loop.advance(20_000_000)
    assert [at // 1000 for at in seen if at >= 0] == [0, 20_000, 40_000, 60_000]
    assert seen.count(-1) == 4
    assert clock.now_ns() - began_ns == 60_000_000
    loop.advance()
    assert len(seen) == 8


def test_played_loops_run_within_each_other(loops: Loops) -> None:
    _, one, other = loops

    async def inner() -> object:
        await asyncio.sleep(1.0)
        return asyncio.get_running_loop()

    async def outer() -> tuple[object, object]:
        await asyncio.sleep(1.0)
        found = other.run(inner())
        other.advance(10**9)
        await asyncio.sleep(1.0)
        return found, asyncio.get_running_loop()

    assert one.run(outer()) == (other, one)
    with pytest.raises(RuntimeError, match="no running event loop"):
        asyncio.get_running_loop()


def test_wait_for_what_never_comes_is_an_error(loops: Loops) -> None:
    _, loop, _ = loops
    with pytest.raises(RuntimeError, match="nothing is left"):
        loop.run(asyncio.Event().wait())
    loop.advance(10**9)
    for task in asyncio.all_tasks(loop):
        task.cancel()
    loop.advance()


def test_real_sockets_are_read_before_time_passes(loops: Loops) -> None:
    clock, loop, _ = loops
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        theirs.send(b"here")
        began_ns = clock.now_ns()
        assert loop.run(loop.sock_recv(ours, 10)) == b"here"
        assert clock.now_ns() == began_ns


def test_each_simulated_program_has_an_event_loop() -> None:
    scheduler, log = Scheduler(), list[tuple[str, int, bool]]()

    async def program(name: str, period_s: float) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(period_s)
            log.append((name, scheduler.now_ns, asyncio.get_running_loop() is loop))

    hosts = [Host(scheduler, name, 1_000_000_007 * (7 + at)) for at, name in enumerate("abc")]
    for at, host in enumerate(hosts):
        work = partial(program, host.name, 1.0 + at)
        host.spawn(lambda work=work: SimulatedLoop().run(work()))  # type: ignore[misc]
    scheduler.run(3_500_000_000)
    hosts[0].kill()
    scheduler.run(6_500_000_000)
    seen = [(name, round(at_ns / 1e9, 6)) for name, at_ns, _ in log]
    assert seen[:5] == [("a", 1.0), ("b", 2.0), ("a", 2.0), ("c", 3.0), ("a", 3.0)]
    assert seen[5:] == [("b", 4.0), ("c", 6.0), ("b", 6.0)]
    assert all(is_own for *_, is_own in log)
    for host in hosts[1:]:
        host.kill()
    assert [host.error for host in hosts] == [None] * 3
    with pytest.raises(RuntimeError, match="no running event loop"):
        asyncio.get_running_loop()
