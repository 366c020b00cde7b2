"""`up` from the outside: it reaches a goal, outlives processes, and is found by other verbs."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import pytest

from checks.harness.crew import Crew, alive, children_of, cmdline, frames_in, real_time
from checks.harness.processes import Running
from checks.harness.until import until
from ground.launch.scenario import CLOCKS, PACED
from ground.recording.log_reader import TlogReader
from ground.user.runs import read_runs
from protocol.outcome import RunOutcome
from protocol.wire.codec import decode
from protocol.wire.messages import Statustext
from tests.support.screens import Tmux

pytestmark = pytest.mark.stack

PATIENCE_S = 60.0
SHORT = """
name = "short"
size_m = [4.0, 3.0]
start = { x_m = 0.7, y_m = 1.1, heading_deg = 0.0 }
goal = { x_m = 1.7, y_m = 1.1, heading_deg = 0.0 }
"""


def sidestep(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "sidestep", *words],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


@contextmanager
def driving(folder: Path) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """Start `up`; yield it on its way, with the processes it has started."""
    words = [sys.executable, "-m", "sidestep", "up", "--json", "--record", str(folder)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as up:
        assert up.stderr is not None
        # Robot, recorder and link are up by now; before, a slow disk may have been complained of.
        assert any(line.startswith("box") for line in iter(up.stderr.readline, ""))
        until(lambda: len(children_of(up.pid)) == 3)
        until(lambda: any(log.stat().st_size > 2000 for log in folder.glob("*.tlog")))
        try:
            yield up, children_of(up.pid)
        finally:
            up.kill()


@pytest.mark.brief
def test_up_reaches_the_goal_by_a_router_with_another_navigator() -> None:
    done = sidestep(
        "up", "--headless", "--speed", "max", "--json", "--router", "--navigator", "bug"
    )
    assert done.returncode == 0, done.stderr
    reached(json.loads(done.stdout))


def reached(found: dict[str, object]) -> None:
    """Require the promised keys, and the goal of the usual world."""
    assert list(found) == [field.name for field in fields(RunOutcome)]
    assert (found["outcome"], found["world"], found["contacts"]) == ("reached", "box", 0)
    assert float(str(found["position_error_m"])) < 0.3


def test_several_robots_reach_goals_of_their_own_the_same_way_every_time(tmp_path: Path) -> None:
    world = tmp_path / "short.toml"
    world.write_text(SHORT)
    words = ("up", "--speed", "max", "--robots", "2", "--world", str(world), "--json")
    runs = []
    for more in ((), ("--plants", "2", "--processes", "1", "--routers", "2")):
        done = sidestep(*words, *more)
        assert done.returncode == 0, done.stderr
        runs.append(json.loads(done.stdout))
    robots = runs[0].pop("robots")
    keys = [field.name for field in fields(RunOutcome)]
    assert list(runs[0]) == keys
    assert [list(one) for one in robots] == [["robot", *keys]] * 2
    assert [(one["robot"], one["outcome"]) for one in robots] == [
        ("r1", "reached"),
        ("r2", "reached"),
    ]
    assert max(one["position_error_m"] for one in robots) < 0.3
    digests = [one["digest"] for one in robots]
    assert digests[0] != digests[1]
    for run in runs[1:]:
        assert [one["digest"] for one in run["robots"]] == digests


@contextmanager
def staying(*words: str) -> Iterator[subprocess.Popen[str]]:
    """Start an `up` that stays; yield it when it says so."""
    command = [sys.executable, "-m", "sidestep", "up", "--headless", "--speed", "2", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as up:
        assert up.stderr is not None
        try:
            assert any(
                line == "short stays until ctrl+c\n" for line in iter(up.stderr.readline, "")
            )
            yield up
        finally:
            up.kill()


@pytest.mark.parametrize("words", [("--stay", "--json"), ("--no-goal",)])
def test_a_stack_that_stays_takes_goals_until_a_signal(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world, records = tmp_path / "short.toml", tmp_path / "records"
    world.write_text(SHORT)
    with staying(*words, "--world", str(world), "--record", str(records)) as up:
        driven = sidestep("goto", "1.2", "1.6", "--json")
        assert json.loads(driven.stdout)["outcome"] == "reached", driven.stderr
        up.send_signal(signal.SIGTERM)
        found = up.communicate(timeout=PATIENCE_S)
    assert up.returncode == 0, found
    (recording,) = records.glob("*.mcap")
    assert f"recording: {recording}" in found[1]
    if words == ("--no-goal",):
        assert not found[0]
    else:
        assert json.loads(found[0])["outcome"] == "reached"


def test_time_runs_out_for_all_robots_in_the_last_tick_of_their_time() -> None:
    done = sidestep("up", "--speed", "max", "--robots", "2", "--timeout", "3", "--json")
    assert done.returncode == 1
    robots = json.loads(done.stdout)["robots"]
    ends = [(one["outcome"], one["time_s"], one["ticks"]) for one in robots]
    assert ends == [("timeout", 3.0, 60)] * 2


def test_without_room_for_all_robots_nothing_is_started(tmp_path: Path) -> None:
    words = ("up", "--world", "corridor", "--robots", "20")
    done = sidestep(*words, "--record", str(tmp_path / "log"))
    assert done.returncode == 2
    assert "corridor has room for 9 beside its start, not for 20" in done.stderr
    assert not (tmp_path / "log").exists()


def test_a_bad_world_starts_nothing(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text('name = "bad"\nsize_m = [1.0]\n')
    done = sidestep("up", "--world", str(tmp_path / "bad.toml"), "--record", str(tmp_path / "log"))
    assert done.returncode == 2
    assert "size_m" in done.stderr
    assert not (tmp_path / "log").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_every_process_and_the_log_is_whole(
    tmp_path: Path, number: signal.Signals
) -> None:
    with driving(tmp_path) as (up, started):
        up.send_signal(number)
        out, err = up.communicate(timeout=PATIENCE_S)
        assert up.returncode == 128 + number
    assert not [pid for pid in started if alive(pid)]
    assert json.loads(out)["ok"] is False
    assert "Traceback" not in err
    assert frames_in(tmp_path) > 20


def test_killed_outright_it_still_leaves_nothing_running(tmp_path: Path) -> None:
    with driving(tmp_path) as (up, started):
        up.send_signal(signal.SIGKILL)
        up.wait()
        until(lambda: not [pid for pid in started if alive(pid)])
    assert frames_in(tmp_path) > 20


@pytest.mark.parametrize("role", ["plant", "robot"])
def test_a_process_that_dies_is_named_with_how_it_died(tmp_path: Path, role: str) -> None:
    with driving(tmp_path) as (up, started):
        (victim,) = [pid for pid in started if f" {role} --" in cmdline(pid)]
        os.kill(victim, signal.SIGKILL)
        out, err = up.communicate(timeout=PATIENCE_S)
    assert up.returncode == 1
    assert f"the {role}" in err
    assert "SIGKILL" in err
    assert json.loads(out)["ok"] is False
    assert not [pid for pid in started if alive(pid)]


def test_up_reaches_the_goal_and_its_recording_becomes_a_table(tmp_path: Path) -> None:
    done = sidestep("up", "--headless", "--speed", "max", "--json", "--record", str(tmp_path))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    reached(found)
    ticks = found["ticks"]
    (log,) = tmp_path.glob("*.tlog")
    table = tmp_path / "run.csv"
    told = json.loads(sidestep("rec", "export", str(log), "--out", str(table), "--json").stdout)
    assert told["lost_bytes"] == 0
    text = table.read_text()
    for name in ("SONAR_SCAN", "WHEEL_COMMAND", "NAVIGATOR_STATUS", "GOAL_REQUEST", "COMMAND_ACK"):
        assert f",{name}," in text
    for name in ("SONAR_SCAN", "WHEEL_TICKS", "CYCLE_REPORT"):
        assert text.count(f",{name},") >= ticks, "the end of the drive is missing"


def test_recording_where_nothing_can_be_written_is_refused() -> None:
    done = sidestep("up", "--record", "/proc/nowhere")
    assert done.returncode == 2
    assert "/proc/nowhere" in done.stderr


DRIVE_S = 60.0
SILENT_S = {"paced": "4.5", "wall": "2.5"}


class Up:
    """`up` under way, and the processes that it has started."""

    def __init__(self, running: Running) -> None:
        self.running = running

    @property
    def pids(self) -> list[int]:
        return children_of(self.running.process.pid)

    def pid(self, verb: str) -> int:
        (found,) = [pid for pid in self.pids if f" {verb} --" in words_of(pid)]
        return found

    def has(self, verb: str, other_than: int) -> bool:
        """Is there one of this verb that is another process?"""
        return any(f" {verb} --" in words_of(pid) for pid in self.pids if pid != other_than)

    def kill(self, verb: str) -> int:
        victim = self.pid(verb)
        os.kill(victim, signal.SIGKILL)
        return victim

    def says(self, words: str) -> None:
        self.running.says(words)

    def result(self) -> dict[str, object]:
        """Return the JSON object at the end; require that no process is left."""
        pids = self.pids
        self.running.ends(DRIVE_S)
        assert not [pid for pid in pids if alive(pid)]
        assert "Traceback" not in self.running.said
        (line,) = [line for line in self.running.said.splitlines() if line.startswith("{")]
        found: dict[str, object] = json.loads(line)
        return found


def words_of(pid: int) -> str:
    """Empty for one that has ended meanwhile."""
    try:
        return cmdline(pid)
    except (FileNotFoundError, ProcessLookupError):
        return ""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Use the clock that is the default, and with `--examples long` each one."""
    if "clock" in metafunc.fixturenames:
        is_long = metafunc.config.getoption("--examples") == "long"
        metafunc.parametrize("clock", CLOCKS if is_long else [PACED])


@contextmanager
def under_way(*words: str) -> Iterator[Up]:
    """Start `up` headless; yield it once the robot drives."""
    with Crew() as crew:
        up = Up(crew.start("up", "--headless", "--world", "open", "--json", *words))
        up.says("driving")
        for pid in up.pids:
            real_time(pid)
        yield up


def test_without_its_robot_there_is_no_trial_but_the_other_one_goes_on(tmp_path: Path) -> None:
    with under_way("--robots", "2", "--goal", "1.8", "2", "--record", str(tmp_path)) as up:
        victim = next(pid for pid in up.pids if " robot --id r2 " in words_of(pid))
        os.kill(victim, signal.SIGKILL)
        why = "the robot r2 process was killed (signal SIGKILL)"
        up.says(f"{why}; restarting")
        found = up.result()
    assert found["ok"] is False
    back = "it is back, but with a fresh state"
    assert str(found["reason"]).startswith(f"no valid trial: {why}; {back}; r1 ")
    (log,) = tmp_path.glob("*-r2.tlog")
    assert "restarted: the previous run was killed (signal SIGKILL)" in texts_in(log)


def texts_in(log: Path) -> str:
    """Return all status texts of the robot, with their pieces joined."""
    with log.open("rb") as source:
        messages = [decode(record.frame).message for record in TlogReader(source)]
    return "".join(one.text for one in messages if isinstance(one, Statustext))


@pytest.mark.realtime
def test_without_its_router_the_robot_stops_by_itself_and_that_is_the_outcome() -> None:
    """Use wall time: the paced simulation would wait for the router."""
    with under_way("--router", "--clock", "wall") as up:
        up.kill("router")
        up.says("the router process was killed (signal SIGKILL); restarting")
        found = up.result()
    assert found["outcome"] == "aborted"


def test_a_recorder_that_dies_is_followed_by_another_one_and_the_robot_drives_on(
    tmp_path: Path,
) -> None:
    with under_way("--goal", "2", "2", "--record", str(tmp_path)) as up:
        (first,) = tmp_path.glob("*.tlog")
        up.kill(f"rec start {tmp_path}")
        up.says("the recorder r1 process was killed (signal SIGKILL); restarting")
        found = up.result()
        assert found["outcome"] == "reached"
    (second,) = set(tmp_path.glob("*.tlog")) - {first}
    second.rename(tmp_path / "elsewhere")
    assert frames_in(tmp_path) > 0
    assert (tmp_path / "elsewhere").stat().st_size > 2000


@pytest.mark.parametrize("born", [False, True])
def test_ctrl_c_while_one_is_started_again_leaves_nothing_behind(born: bool) -> None:
    with under_way() as up:
        before = up.pids
        victim = up.kill("robot")
        if born:
            until(lambda: up.has("robot", other_than=victim), what="the next one")
        after = up.pids
        up.running.send(signal.SIGINT)
        assert up.running.ends() == 130
        until(lambda: not [pid for pid in {*before, *after} if alive(pid)], what="nobody")
        assert "Traceback" not in up.running.said


@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_app_shows_which_process_was_restarted_and_why(clock: str, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "sidestep", "up", "--clock", clock, "--world", "open"]
    words += ["--no-record"]
    with Tmux(tmp_path, words, (140, 30), {"COLUMNS": "140"}) as tmux:
        tmux.shows("read: ready")
        tmux.press("7")
        tmux.shows("end robot r1", "hang plant")
        tmux.press("j", "j", "s", "s", "4")
        tmux.shows(
            "the robot r1 process was killed (signal SIGKILL); restarting",
            "restarted: the previous run was killed (signal SIGKILL)",
            "r1 has been restarted (1)",
        )
        tmux.press("1")
        tmux.shows("DISARMED")
        tmux.press("7", "j", "s", "s", "4")
        tmux.shows(
            f"the plant process hung (silent for {SILENT_S[clock]} s); restarting",
            "position lost: sensor stream restarted",
            "the plant of r1 has been restarted (1)",
        )
        tmux.press("C-q", "C-q")
        assert tmux.ends() == 0


@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_app_changes_the_world_and_drives_without_a_loss(clock: str, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "sidestep", "up", "--clock", clock, "--world", "box"]
    words += ["--no-record"]
    with Tmux(tmp_path, words, (140, 40), {"COLUMNS": "140"}) as tmux:
        tmux.shows("read: ready")
        tmux.press("6")
        tmux.shows("18 worlds", "shortest way")
        tmux.press("j", "j", "j")
        tmux.shows("One round obstacle", "disc  ")
        tmux.press("s", "s", "4")
        tmux.shows("disc: to (5.400, 2.000)")
        tmux.press("1")
        shown = tmux.shows("disc: to (5.400, 2.000)", "AUTO ▸ ARMED")
        assert not [words for words in ("DEAD", "HUNG", "LOST", "STALE") if words in shown]
        tmux.press("4")
        log = tmux.shows("vehicle ACTIVE", "read: ready")
        # A link that pauses for its lease of 1 s, because the machine is busy, is no loss.
        assert not [words for words in ("DEAD", "killed", "hung", "restarted") if words in log]
        tmux.press("C-q", "C-q")
        assert tmux.ends() == 0


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


@pytest.mark.usefixtures("state")
def test_a_verb_without_an_endpoint_finds_what_up_runs() -> None:
    with Crew() as crew:
        up = crew.start("up", "--headless", "--world", "open")
        up.says("driving")
        assert "endpoint tcp/127.0.0.1:" in up.said
        watch = crew.start("watch", "--once", "--json")
        assert watch.ends() == 0, watch.said
        ps = crew.start("ps", "--json")
        assert ps.ends() == 0
        (row,) = json.loads(ps.said)["runs"]
        assert (row["name"], row["world"], row["robots"]) == ("open", "open", ["r1"])
        assert set(row["processes"]) == {"robot r1", "plant"}
        assert all(map(alive, row["processes"].values()))
        up.send(signal.SIGINT)
        up.ends()
        assert read_runs() == ([], [])


@pytest.mark.usefixtures("state")
def test_two_runs_are_told_apart_and_a_killed_one_is_forgotten() -> None:
    with Crew() as crew:
        ups = [crew.start("up", "--headless", "--world", "open") for _ in range(2)]
        for up in ups:
            up.says("driving")
        refused = crew.start("hold")
        assert refused.ends() == 2
        assert "choose one with --run NAME" in refused.said
        first = next(one for one in read_runs().found if one.run.pid == ups[0].process.pid)
        held = crew.start("hold", "--run", first.name)
        assert held.ends() == 0, held.said
        ups[0].send(signal.SIGKILL)
        ups[0].ends()
        assert [one.run.pid for one in read_runs().found] == [ups[1].process.pid]


@pytest.mark.usefixtures("state")
def test_the_app_prints_outcome_and_recording_when_it_is_left(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "sidestep", "up", "--world", "open"]
    with Tmux(tmp_path, words, (110, 30)) as tmux:
        tmux.shows("pose", "AUTO")
        tmux.press("C-q", "C-q")
        assert tmux.ends() == 0
        screen = tmux.shows("recording:", "sidestep replay")
        assert "r1: was driving to (5.400, 2.000)" in screen


@pytest.mark.usefixtures("state")
def test_a_restarted_robot_has_its_new_process_in_the_list() -> None:
    with Crew() as crew:
        crew.start("up", "--headless", "--world", "open").says("driving")
        victim = read_runs().found[0].run.processes["robot r1"]
        os.kill(victim, signal.SIGKILL)
        until(lambda: read_runs().found[0].run.processes.get("robot r1", victim) != victim)
