"""`ps` lists what `up` runs here."""

import json
import os
from pathlib import Path

import pytest

from ground.cli.main import main
from tests.support.ground.runs import ENDPOINT, written


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def test_without_a_run_it_names_the_command_that_starts_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["ps"]) == 0
    assert capsys.readouterr().out == "nothing runs here. Start it: sidestep up\n"


def test_each_run_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    written()
    written("tcp/127.0.0.1:1", "a_longer_world")
    assert main(["ps"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    for name in ("NAME", "SINCE", "ROBOTS", "WORLD", "ENDPOINT", "PROCESSES"):
        at = head.index(name)
        assert all(line[at] != " " and (at == 0 or line[at - 1] == " ") for line in lines)
    assert ENDPOINT in lines[0]
    assert lines[0].endswith(f"up {os.getpid()}, plant 5")


def test_json_has_every_fact(capsys: pytest.CaptureFixture[str]) -> None:
    written()
    main(["ps", "--json"])
    (row,) = json.loads(capsys.readouterr().out)["runs"]
    assert (row["name"], row["endpoint"], row["robots"]) == ("box", ENDPOINT, ["r1"])
    assert (row["world"], row["pid"], row["processes"]) == ("box", os.getpid(), {"plant": 5})


def test_a_corrupt_file_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written().path
    assert file is not None
    file.write_text("{")
    assert main(["ps", "--json"]) == 0
    done = capsys.readouterr()
    assert f"{file}: is not a runtime file" in done.err
    assert json.loads(done.out)["ignored"][0]["file"] == str(file)
