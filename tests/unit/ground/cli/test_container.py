"""A verb in a container finds out its robot, its start pose and its network."""

import argparse
import errno
import os
import socket
import stat
import subprocess
from pathlib import Path

import pytest

from ground.cli.main import main, parse
from ground.cli.observe import health
from ground.cli.run.container import addresses, place_of, words_of
from plant.model.configuration import body_of
from plant.placement import starts
from plant.world.file import load
from runtime.errors import UserError
from tests.support.each import each

HERE = "172.19.0.4"
NAMES = {
    socket.gethostname(): {HERE, "172.20.0.9"},
    "sidestep-robot-1": {"172.19.0.3"},
    "sidestep-robot-2": {HERE},
    "robot": {"172.19.0.3", HERE},
}
SECOND = ("--replica", "sidestep-robot-", "--robots", "2")


def lookup(name: str) -> frozenset[str]:
    return frozenset(NAMES.get(name, ()))


def options(*words: str) -> argparse.Namespace:
    found: argparse.Namespace = parse(["berth", *words])
    return found


def became(*words: str) -> list[str]:
    found = options(*words)
    return words_of(found, place_of(found, lookup))


def after(words: list[str], option: str, count: int = 1) -> list[str]:
    place = words.index(option) + 1
    return words[place : place + count]


def test_a_container_has_the_robot_of_its_number() -> None:
    assert became(*SECOND, "record", "/recordings") == ["rec", "start", "--id", "r2", "/recordings"]


def test_placeholder_is_replaced_by_the_robots_name() -> None:
    found = became(*SECOND, "robot", "--state", "/state/{id}")
    assert after(found, "--state") == ["/state/r2"]


def test_robot_gets_the_start_of_its_number() -> None:
    world = load("box")
    places = starts(world, body_of(world), 2)
    for words, place in (((), places[0]), (SECOND, places[1])):
        added = after(became(*words, "--world", "box", "robot"), "--start", 3)
        assert [float(word) for word in added[:2]] == pytest.approx(place[:2])


def test_a_robot_has_the_calibration_of_its_worlds_noise() -> None:
    noisy = became("--noise", "harsh", "robot")
    clean = became("--noise", "none", "robot")
    assert [w for w in noisy if "=" in w] != [w for w in clean if "=" in w]


def test_the_plant_carries_as_many_as_there_are() -> None:
    assert after(became("plant"), "--robots") == ["r1"]
    assert after(became("--robots", "3", "plant"), "--robots") == ["r1,r2,r3"]


def test_plant_and_robot_run_on_the_chosen_clock() -> None:
    paced = ("--clock", "paced")
    assert "--lockstep" in became(*paced, "robot")
    assert after(became(*paced, "plant"), "--lockstep", 2) == ["--speed", "1"]
    for words in (("robot",), ("plant",), ("--clock", "wall", "plant")):
        assert "--lockstep" not in became(*words)


def test_plant_counts_the_robots_of_compose() -> None:
    for words, names in (((), "r1,r2"), (("--robots", "3"), "r1,r2,r3")):
        assert after(became("--counted", "robot", *words, "plant"), "--robots") == [names]


def test_replica_need_not_be_told_how_many_robots_there_are() -> None:
    found = became("--replica", "sidestep-robot-", "robot")
    assert after(found, "--id") == ["r2"]
    assert after(found, "--start", 3) == after(became(*SECOND, "robot"), "--start", 3)
    places = after(became(*SECOND, "--robots", "9", "robot"), "--start", 3)
    assert after(found, "--start", 3) == places


def test_plant_gets_world_noise_and_seed() -> None:
    found = became("--world", "open", "--noise", "lossy", "--seed", "7", "plant", "--lockstep")
    added = ["--world", "open", "--seed", "7", "--robots", "r1", "--noise", "lossy", "--lockstep"]
    assert found == ["run", "plant", *added]
    assert "--noise" not in became("plant")


def test_goto_without_a_goal_uses_the_goal_of_up() -> None:
    assert became("goto") == ["goto", "5.4", "2.0", "0.0"]
    second = became(*SECOND, "goto")
    assert second[:3] != ["goto", "5.4", "2.0"]
    assert second[-2:] == ["--id", "r2"]
    assert became("goto", "2", "1") == ["goto", "2", "1"]


def test_the_first_file_that_is_there_is_the_network(tmp_path: Path) -> None:
    keys, bus = tmp_path / "robot-{id}.toml", tmp_path / "bus.toml"
    both = ("--config", str(keys), "--config", str(bus), *SECOND, "hold")
    bus.write_text("")
    assert after(became(*both), "--config") == [str(bus)]
    (tmp_path / "robot-r2.toml").write_text("")
    assert after(became(*both), "--config") == [str(tmp_path / "robot-r2.toml")]


def forbidding(monkeypatch: pytest.MonkeyPatch, call: str) -> None:
    """Raise PermissionError, because the tests may run as root."""

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, call, refused)


@pytest.mark.parametrize("call", ["stat", "iterdir"])
def test_unreadable_key_folder_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    keys, bus = tmp_path / "keys" / "bus.toml", tmp_path / "bus.toml"
    bus.write_text("")
    forbidding(monkeypatch, call)
    with pytest.raises(UserError, match=r"keys.*: Permission denied"):
        became("--config", str(keys), "--config", str(bus), "hold")


def test_robot_with_only_keys_of_others_does_not_start(tmp_path: Path) -> None:
    bus = tmp_path / "bus.toml"
    bus.write_text("")
    (tmp_path / "keys").mkdir()
    both = ("--config", str(tmp_path / "keys" / "bus-{id}.toml"), "--config", str(bus))
    assert after(became(*both, *SECOND, "hold"), "--config") == [str(bus)]
    (tmp_path / "keys" / "robot-r1.key").write_text("")
    with pytest.raises(UserError, match=r"holds robot-r1\.key but not bus-r2\.toml"):
        became(*both, *SECOND, "hold")


def test_robot_with_only_folders_of_others_does_not_start(tmp_path: Path) -> None:
    bus = tmp_path / "bus.toml"
    bus.write_text("")
    both = ("--config", str(tmp_path / "keys" / "{id}" / "bus.toml"), "--config", str(bus))
    assert after(became(*both, *SECOND, "hold"), "--config") == [str(bus)]
    (tmp_path / "keys" / "r1").mkdir(parents=True)
    with pytest.raises(UserError, match=r"keys holds r1 but not r2/bus\.toml"):
        became(*both, *SECOND, "hold")
    (tmp_path / "keys" / "r2").mkdir()
    (tmp_path / "keys" / "r2" / "bus.toml").write_text("")
    found = after(became(*both, *SECOND, "hold"), "--config")
    assert found == [str(tmp_path / "keys" / "r2" / "bus.toml")]


def test_each_robot_gets_its_own_user_and_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[tuple[str, object]] = []
    for name in ("setgroups", "setgid", "setuid", "umask"):
        monkeypatch.setattr(os, name, lambda to, name=name: called.append((name, to)))
    monkeypatch.setattr(os, "execvp", lambda _file, words: called.append(("exec", words[2])))
    own = tmp_path / "state-{id}"
    main(["berth", "--users", "20000", "--own", str(own), "plant"])
    rights = [("umask", 0o077), ("setgroups", []), ("setgid", 20001), ("setuid", 20001)]
    assert called == [*rights, ("exec", "plant")]
    assert stat.S_IMODE((tmp_path / "state-r1").stat().st_mode) == 0o700


def test_a_process_that_is_the_user_does_not_switch(monkeypatch: pytest.MonkeyPatch) -> None:
    became: list[list[str]] = []
    monkeypatch.setattr(os, "execvp", lambda _file, words: became.append(words))
    monkeypatch.setattr(os, "umask", lambda _: None)
    monkeypatch.setattr(os, "getuid", lambda: 20001)
    monkeypatch.setattr(os, "getgid", lambda: 20001)
    monkeypatch.setattr(os, "setgroups", lambda _: pytest.fail("it switched"))
    main(["berth", "--users", "20000", "plant"])
    assert len(became) == 1


def test_failed_user_switch_or_foreign_folder_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def forbidden(_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "setgroups", forbidden)
    assert main(["berth", "--users", "20000", "plant"]) == 2
    assert "cannot switch to user 20001: start the container as root" in capsys.readouterr().err
    monkeypatch.setattr(os, "geteuid", lambda: 4711)
    assert main(["berth", "--own", str(tmp_path), "plant"]) == 2
    assert "belongs to user" in capsys.readouterr().err


def test_missing_config_is_left_to_the_verb(tmp_path: Path) -> None:
    missing = str(tmp_path / "none.toml")
    assert after(became("--config", missing, "hold"), "--config") == [missing]


@each(
    ("takes", "verb"),
    [
        *((True, verb) for verb in ("hold", "robot", "plant", "router", "ground", "health")),
        *((False, verb) for verb in ("worlds", "trial", "export", "fly")),
    ],
)
def test_offline_verb_gets_no_network_option(takes: bool, verb: str) -> None:
    assert ("--config" in became("--config", "bus.toml", verb)) is takes


def test_a_container_that_is_none_of_the_robots_is_refused() -> None:
    with pytest.raises(UserError, match="none of other-1 to other-20 resolves to this container"):
        became("--replica", "other-", "robot")


def test_missing_verb_shows_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["berth"]) == 2
    assert capsys.readouterr().err == (
        "sidestep run container: the verb is missing, "
        "as in: sidestep run container --robots 2 run plant\n"
    )


def test_a_world_that_is_not_there_is_refused_in_its_own_words(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["berth", "--world", "atlantis", "robot"]) == 2
    assert "atlantis" in capsys.readouterr().err


def test_it_becomes_the_executable(monkeypatch: pytest.MonkeyPatch) -> None:
    became: list[list[str]] = []
    monkeypatch.setattr(os, "execvp", lambda _file, words: became.append(words))
    main(["berth", "plant"])
    assert became == [
        ["sidestep", "run", "plant", "--world", "box", "--seed", "0", "--robots", "r1"]
    ]


def test_a_health_check_runs_in_this_process_and_marks_success(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "execvp", lambda *_: pytest.fail("another process"))
    (tmp_path / "bus.toml").write_text("[network]\nconnect = ['tcp/127.0.0.1:1']\n")
    mark = tmp_path / "healthy"
    options = ["--config", str(tmp_path / "bus.toml"), "--healthy", str(mark)]
    words = ["berth", *options, "health", "robot"]
    assert main(words) == 1
    assert "tcp/127.0.0.1:1" in capsys.readouterr().err
    assert not mark.exists()
    monkeypatch.setattr(health, "run", lambda *_: 0)
    assert main(words) == 0
    assert mark.exists()


CHECK = Path(__file__).parents[4] / "docker" / "health"


def checked(folder: Path, now_s: int, *, succeeds: bool) -> list[str]:
    """Return what the script of the containers' checks does at a time, one word a program."""
    mark, calls, programs = folder / "healthy", folder / "calls", folder / "bin"
    programs.mkdir(exist_ok=True)
    result = f"touch -d @{now_s} {mark}" if succeeds else "exit 1"
    for name, body in (("check", result), ("sleep", ":")):
        (programs / name).write_text(f"#!/bin/sh\necho {name} $1 >>{calls}\n{body}\n")
    (programs / "date").write_text(f"#!/bin/sh\necho {now_s}\n")
    for program in programs.iterdir():
        program.chmod(0o755)
    script = folder / "health"
    script.write_text(CHECK.read_text().replace("last=/tmp/healthy", f"last={mark}"))
    calls.write_text("")
    path = f"{programs}:{os.environ['PATH']}"
    done = subprocess.run(["sh", script, "check"], env={"PATH": path}, check=False)
    assert done.returncode == (0 if succeeds else 1)
    return calls.read_text().split()


def test_only_a_healthy_container_waits_for_its_next_check(tmp_path: Path) -> None:
    assert checked(tmp_path, 1000, succeeds=False) == ["check"]
    assert checked(tmp_path, 1001, succeeds=True) == ["check"]
    assert checked(tmp_path, 1011, succeeds=True) == ["sleep", "20", "check"]
    assert checked(tmp_path, 1012, succeeds=False) == ["sleep", "29", "check"]
    assert checked(tmp_path, 1013, succeeds=True) == ["check"]
    assert checked(tmp_path, 1043, succeeds=True) == ["check"]  # it was paused, for example
    assert checked(tmp_path, 500, succeeds=True) == ["check"]  # the clock was set back


def test_missing_executable_is_an_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert main(["berth", "plant"]) == 2
    assert "`sidestep` is not on the PATH" in capsys.readouterr().err


def test_unknown_name_has_no_address() -> None:
    assert addresses("localhost") & {"127.0.0.1", "::1"}
    assert addresses("no-such-name.invalid") == frozenset()
