"""Runs of `up`: private runtime files, removed after dead runs, and the only one that is here."""

import os
import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest

from ground.cli.main import parse
from ground.cli.options import common_of
from ground.client.connection import START_HINT, UP_HINT, common
from ground.client.vocabulary import PYTHON
from ground.text.output import Output
from ground.user.runs import Run, RunFile, age_text, read_runs, start_of
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.runs import ENDPOINT, run_here, written


def put(folder: Path, text: bytes, name: str = "box.json") -> Path:
    folder.mkdir(mode=0o700, exist_ok=True)
    path = folder / name
    path.write_bytes(text)
    path.chmod(0o600)
    return path


def encoded(**changed: object) -> bytes:
    return msgspec.json.encode(msgspec.to_builtins(run_here()) | changed)


def test_a_run_is_found_until_its_file_is_removed(tmp_path: Path) -> None:
    folder = tmp_path / "state" / "run"
    file, run = RunFile("box", folder), run_here()
    assert read_runs(folder) == ([], [])
    file.write(run)
    assert read_runs(folder) == ([("box", run)], [])
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert [stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()] == [0o600]
    file.remove()
    assert list(folder.iterdir()) == []


def test_a_second_write_replaces_the_first(tmp_path: Path) -> None:
    file = RunFile("box", tmp_path)
    file.write(run_here(world="box"))
    file.write(run_here(world="moving"))
    ((name, run),) = read_runs(tmp_path).found
    assert (name, run.world) == ("box", "moving")


def test_two_runs_of_one_world_have_two_files(tmp_path: Path) -> None:
    files = [RunFile("box", tmp_path) for _ in range(3)]
    for file in files:
        file.write(run_here())
    assert {one.name for one in read_runs(tmp_path).found} == {"box", "box-2", "box-3"}
    files[0].remove()
    RunFile("box", tmp_path).write(run_here())
    assert {one.name for one in read_runs(tmp_path).found} == {"box", "box-2", "box-3"}


@pytest.mark.parametrize(("world", "stem"), [("../../x y", "x-y"), ("--", "run"), ("ä", "run")])
def test_the_name_of_a_world_never_leaves_the_folder(tmp_path: Path, world: str, stem: str) -> None:
    file = RunFile(world, tmp_path)
    file.write(run_here())
    assert file.path == tmp_path / f"{stem}.json"


def test_the_file_of_a_dead_process_is_removed(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    path = put(tmp_path, encoded(pid=ended.pid))
    assert read_runs(tmp_path) == ([], [])
    assert not path.exists()


def test_a_reused_process_id_is_not_the_run(tmp_path: Path) -> None:
    path = put(tmp_path, encoded(start="another boot 1"))
    assert read_runs(tmp_path) == ([], [])
    assert not path.exists()


def test_a_run_of_another_machine_is_kept_and_not_used(tmp_path: Path) -> None:
    path = put(tmp_path, encoded(host="elsewhere"))
    assert read_runs(tmp_path) == ([], [])
    assert path.exists()


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{",
        b"[]",
        b"\xff\x00",
        b"[" * 70_000,
        encoded(endpoint="nonsense"),
        encoded(robots=[]),
        encoded(robots=["../r1"]),
        encoded(pid="x"),
        encoded(since="yesterday"),
        encoded(since="2026-11-23T10:00:00"),
    ],
)
def test_a_corrupt_file_is_reported_and_kept(tmp_path: Path, text: bytes) -> None:
    path = put(tmp_path, text)
    found, ((ignored, why),) = read_runs(tmp_path)
    assert (found, ignored) == ([], path)
    assert "not a runtime file" in why
    assert path.exists()
    file = RunFile("box", tmp_path)
    file.write(run_here())
    assert file.path == tmp_path / "box-2.json"


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_a_file_that_others_can_use_is_ignored(tmp_path: Path, mode: int) -> None:
    put(tmp_path, encoded()).chmod(mode)
    found, ((_, why),) = read_runs(tmp_path)
    assert found == []
    assert f"{mode:04o}" in why


def test_a_file_of_another_user_is_ignored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, encoded())
    mine = os.geteuid()
    facts = tmp_path.joinpath("box.json").stat()
    assert facts.st_uid == mine
    monkeypatch.setattr("os.geteuid", lambda: mine + 1)
    found, ((_, why),) = read_runs(tmp_path)
    assert found == []
    assert why == f"belongs to user {mine}"


def test_a_folder_that_others_can_write_is_ignored(tmp_path: Path) -> None:
    put(tmp_path, encoded())
    tmp_path.chmod(0o777)
    found, ((path, why),) = read_runs(tmp_path)
    assert (found, path) == ([], tmp_path)
    assert "0777" in why


def test_a_link_to_a_file_elsewhere_is_ignored(tmp_path: Path) -> None:
    target = put(tmp_path / "other", encoded())
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "box.json").symlink_to(target)
    found, ignored = read_runs(folder)
    assert (found, len(ignored)) == ([], 1)


def test_a_pipe_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "box.json", 0o600)
    assert read_runs(tmp_path).ignored[0].why == "is not a file"


def test_fields_of_a_newer_version_are_ignored(tmp_path: Path) -> None:
    put(tmp_path, encoded(colour="blue"))
    assert len(read_runs(tmp_path).found) == 1


def test_a_process_has_one_start_until_it_has_ended() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        first = start_of(other.pid)
        assert first
        assert start_of(other.pid) == first != start_of(os.getpid())
        other.communicate()
    assert start_of(other.pid) is None


def test_a_zombie_has_ended() -> None:
    pid = os.fork()
    if pid == 0:
        os._exit(0)
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    assert start_of(pid) is None
    os.waitpid(pid, 0)


@each(("seconds", "text"), [(-5, "0 min"), (59, "0 min"), (240, "4 min"), (7260, "2 h 1 min")])
def test_ages_are_in_minutes_and_hours(seconds: float, text: str) -> None:
    now = datetime.now(UTC)
    assert age_text(now - timedelta(seconds=seconds), now) == text


def test_a_run_survives_the_file(tmp_path: Path) -> None:
    run: Run = run_here(locks="keys")
    assert run.locks == str(Path("keys").resolve())
    RunFile("box", tmp_path).write(run)
    assert read_runs(tmp_path).found[0].run == run


OTHER = "tcp/127.0.0.1:40000"


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


@pytest.mark.usefixtures("state")
def test_the_only_run_is_used(capsys: pytest.CaptureFixture[str]) -> None:
    file = written()
    found = common_of(parse(["hold"]), Output(as_json=False))
    assert (found.endpoint, found.robot) == (ENDPOINT, "r1")
    found_at = capsys.readouterr()
    assert (found_at.out, found_at.err.splitlines()[0]) == ("", f"run box at {ENDPOINT}")
    file.remove()
    assert common_of(parse(["hold"])).endpoint == "tcp/127.0.0.1:7447"


@pytest.mark.usefixtures("state")
@pytest.mark.parametrize("verb", ["doctor", "watch", "ground", "ghost", "explain"])
def test_every_verb_that_dials_finds_it(verb: str) -> None:
    written()
    words = [verb, "--navigator", "bug"] if verb == "ghost" else [verb]
    assert common_of(parse(words)).endpoint == ENDPOINT


@pytest.mark.usefixtures("state")
def test_an_endpoint_or_a_file_that_is_given_wins(tmp_path: Path) -> None:
    written()
    assert common_of(parse(["hold", "--connect", OTHER])).endpoint == OTHER
    file = tmp_path / "ground.toml"
    file.write_text(f'[network]\nconnect = ["{OTHER}"]\n')
    assert common_of(parse(["hold", "--config", str(file)])).endpoint == OTHER


@pytest.mark.usefixtures("state")
def test_a_file_without_an_endpoint_means_the_usual_one(tmp_path: Path) -> None:
    written()
    file = tmp_path / "ground.toml"
    file.write_text('robot = "r2"\n')
    found = common_of(parse(["hold", "--config", str(file)]))
    assert (found.endpoint, found.robot) == ("tcp/127.0.0.1:7447", "r2")


@pytest.mark.usefixtures("state")
def test_several_runs_are_listed_and_one_is_chosen_by_name() -> None:
    written()
    written(OTHER, "u_trap")
    with pytest.raises(UserError) as caught:
        common_of(parse(["hold"]))
    for word in ("box", ENDPOINT, "u_trap", OTHER, "--run NAME", "--connect"):
        assert word in str(caught.value)
    assert common_of(parse(["hold", "--run", "u_trap"])).endpoint == OTHER
    assert common_of(parse(["hold", "--connect", "tcp/h:1"])).endpoint == "tcp/h:1"


@pytest.mark.usefixtures("state")
def test_one_of_several_runs_is_chosen_in_the_words_of_python() -> None:
    written()
    written(OTHER, "u_trap")
    with pytest.raises(UserError) as caught:
        common(None, None, None, remedies=PYTHON)
    assert f"choose one with sidestep.connect({ENDPOINT!r})" in str(caught.value)
    assert "--" not in str(caught.value)


@pytest.mark.usefixtures("state")
def test_an_unknown_run_is_refused_with_those_that_are_there() -> None:
    with pytest.raises(UserError, match=r"--run box: there is no such run; nothing runs here"):
        common_of(parse(["hold", "--run", "box"]))
    written()
    with pytest.raises(UserError, match=rf"here run: box \({ENDPOINT}\)"):
        common_of(parse(["hold", "--run", "bax"]))


@pytest.mark.usefixtures("state")
def test_a_run_and_an_endpoint_exclude_each_other() -> None:
    written()
    for words in (["--run", "box", "--connect", OTHER], ["--run", "box", "--context", "lab"]):
        with pytest.raises(UserError, match="use only one of --connect"):
            common_of(parse(["hold", *words]))


@pytest.mark.usefixtures("state")
def test_a_run_with_certificates_needs_no_file(tmp_path: Path) -> None:
    (tmp_path / "ground.toml").write_text(
        '[network.tls]\nca = "ca.pem"\ncertificate = "g.pem"\nkey = "g.key"\n'
    )
    written("tls/127.0.0.1:5000", locks=str(tmp_path))
    found = common_of(parse(["hold"]))
    assert found.network.tls is not None
    assert found.network.tls.certificate == str(tmp_path / "g.pem")
    assert found.config == str(tmp_path / "ground.toml")


@pytest.mark.usefixtures("state")
def test_without_a_run_the_error_names_the_next_command() -> None:
    assert common_of(parse(["hold"])).hint == START_HINT
    assert common_of(parse(["hold", "--connect", OTHER])).hint == UP_HINT
