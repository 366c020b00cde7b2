"""Each command that takes a world file rejects an invalid one before it starts anything."""

import socket
from pathlib import Path
from typing import NamedTuple

import pytest

from ground.cli.main import main
from ground.cli.run import up
from ground.launch.child_processes import Children
from tests.support.plant.world_texts import GOOD, goal, more
from tests.support.stack.processes import Crew

pytestmark = pytest.mark.stack


class Spoilt(NamedTuple):
    """A text, and the words of its error message: line and key, reason, fix."""

    text: str
    words: tuple[str, ...]


UNKNOWN = Spoilt(more("colour = 1\n"), (":20: obstacle#4.colour", "unknown key", "fix: "))
OUTSIDE = Spoilt(
    goal("{ x_m = 9.0, y_m = 2.0, heading_deg = 0.0 }"), (":4: goal", "outside", "fix: ")
)


@pytest.mark.parametrize("spoilt", [UNKNOWN, OUTSIDE], ids=["structure", "geometry"])
def test_it_is_refused_with_file_key_reason_and_fix(spoilt: Spoilt, tmp_path: Path) -> None:
    """All kinds of mistakes are in tests/unit/plant/world."""
    file, log = tmp_path / "spoilt.toml", tmp_path / "log"
    file.write_text(spoilt.text, encoding="utf-8")
    with Crew() as crew, socket.create_server(("127.0.0.1", 0)) as hub:
        hub.setblocking(False)
        endpoint = f"tcp/127.0.0.1:{hub.getsockname()[1]}"
        refused = [
            crew.start("up", "--world", str(file), "--record", str(log)),
            crew.start("plant", "--world", str(file), "--connect", endpoint),
            crew.start("trial", "--world", str(file), "--navigator", "bug", "--json"),
        ]
        for running in refused:
            assert running.ends() == 2, running.said
            assert "Traceback" not in running.said
            assert f"{file}:" in running.said
            for word in spoilt.words:
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
    file.write_text(OUTSIDE.text, encoding="utf-8")
    assert main(["up", "--world", str(file)]) == 2
    assert started == []
    assert "goal" in capsys.readouterr().err
