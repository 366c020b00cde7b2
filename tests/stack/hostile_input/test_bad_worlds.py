"""Each command that takes a world file rejects an invalid one before it starts anything."""

import socket
from pathlib import Path
from typing import NamedTuple

import pytest

from ground.cli.main import main
from ground.cli.run import up
from ground.launch.child_processes import Children
from tests.support.plant.world_texts import GOOD, goal, more, polygon, start, with_line
from tests.support.stack.processes import Crew


class Spoilt(NamedTuple):
    """A text, and the words of its error message: line and key, reason, fix."""

    text: str
    words: tuple[str, ...]


SPOILT = {
    "missing key": Spoilt(with_line(2, ""), ("size_m", "missing", "fix: ")),
    "unknown key": Spoilt(more("colour = 1\n"), (":20: obstacle#4.colour", "unknown key", "fix: ")),
    "wrong unit": Spoilt(
        start("{ x_cm = 60.0, y_m = 2.0, heading_deg = 0.0 }"), (":3: start.x_cm", "x_m", "fix: ")
    ),
    "self-crossing polygon": Spoilt(
        polygon("[[2.0, 1.0], [3.0, 1.5], [3.0, 1.0], [2.0, 1.5]]"),
        (":7: obstacle#1.polygon_m", "cross", "fix: "),
    ),
    "start in an obstacle": Spoilt(
        start("{ x_m = 2.5, y_m = 1.25, heading_deg = 0.0 }"), (":3: start", "obstacle", "fix: ")
    ),
    "goal outside": Spoilt(
        goal("{ x_m = 9.0, y_m = 2.0, heading_deg = 0.0 }"), (":4: goal", "outside", "fix: ")
    ),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_it_is_refused_with_file_key_reason_and_fix(kind: str, tmp_path: Path) -> None:
    file, log = tmp_path / "spoilt.toml", tmp_path / "log"
    file.write_text(SPOILT[kind].text, encoding="utf-8")
    with Crew() as crew, socket.create_server(("127.0.0.1", 0)) as hub:
        hub.setblocking(False)
        endpoint = f"tcp/127.0.0.1:{hub.getsockname()[1]}"
        refused = {
            "up": crew.start("up", "--world", str(file), "--record", str(log)),
            "plant": crew.start("plant", "--world", str(file), "--connect", endpoint),
            "trial": crew.start("trial", "--world", str(file), "--navigator", "bug", "--json"),
        }
        for running in refused.values():
            assert running.ends() == 2, running.said
            assert "Traceback" not in running.said
            assert f"{file}:" in running.said
            for word in SPOILT[kind].words:
                assert word in running.said
        with pytest.raises(BlockingIOError):
            hub.accept()  # the plant has not even dialled
    assert not log.exists()


def test_the_good_world_they_were_made_of_is_taken(tmp_path: Path) -> None:
    file = tmp_path / "good.toml"
    file.write_text(GOOD, encoding="utf-8")
    with Crew() as crew:
        shown = crew.start("worlds", "check", str(file))
        assert shown.ends() == 0, shown.said


def test_up_starts_no_process_for_a_bad_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    started: list[str] = []
    monkeypatch.setattr(Children, "start", lambda _, role, words: started.append(role))
    monkeypatch.setattr(up, "free_endpoint", lambda: started.append("endpoint"))
    file = tmp_path / "spoilt.toml"
    file.write_text(SPOILT["goal outside"].text, encoding="utf-8")
    assert main(["up", "--world", str(file)]) == 2
    assert started == []
    assert "goal" in capsys.readouterr().err
