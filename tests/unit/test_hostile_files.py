"""Control characters in files and file names never reach the terminal."""

import json
from contextlib import suppress
from pathlib import Path

import pytest

import sidestep
from ground.recording.log_reader import record_bytes
from protocol.wire.codec import Encoder
from protocol.wire.messages import Statustext
from tests.support.hostile import OWNED, TEXT, raw_in

ESCAPED = json.dumps(TEXT)
NAME = TEXT.replace("/", "") + "\udcff"
"""The last letter is a byte of a name that is not UTF-8."""

WORLD = f"""
name = {ESCAPED}
size_m = [4.0, 2.0]
start = {{ x_m = 0.5, y_m = 1.0, heading_deg = 0.0 }}
goal = {{ x_m = 3.5, y_m = 1.0 }}
"""
FILES = {
    "good.toml": WORLD,
    "keys.toml": f"{WORLD}\n{ESCAPED} = 1\n[robot]\n{ESCAPED} = 2\n[[fault]]\nkind = {ESCAPED}\n",
    "world.json": json.dumps({"name": TEXT, TEXT: TEXT, "size_m": TEXT}),
    "text.toml": f"a = {TEXT}",
    "mission.toml": f"[[item]]\nkind = {ESCAPED}\n{ESCAPED} = 3\n",
    "mission.plan": json.dumps({"fileType": TEXT, "mission": {"items": [{"type": TEXT}]}}),
    "mission.waypoints": f"QGC WPL 110\n{TEXT}\t1\n",
    "config.toml": f"{ESCAPED} = 1\n",
    "keymap.toml": f"[keys]\n{ESCAPED} = [{ESCAPED}]\n",
    "grid.map": f"type {TEXT}\nheight 1\n",
}
LINES = (
    "worlds check good.toml", "worlds show good.toml", "worlds check keys.toml",
    "worlds check world.json", "worlds check text.toml", "worlds check nowhere.toml",
    "trial --world keys.toml", "worlds import grid.map --out out", "mission check mission.toml",
    "mission check mission.plan", "mission check mission.waypoints", "mission check text.toml",
    "doctor --config config.toml", "doctor --config text.toml", "run robot --config config.toml",
    "run plant --config config.toml", "ground --print-keys --keys keymap.toml",
    "replay r1.tlog --plain", "replay r1.tlog --json", "rec export r1.tlog",
    "rec plot r1.tlog --out a.png", "explain r1.tlog", "replay nowhere.tlog",
    "ghost r1.tlog --navigator bug", "keys check no.where",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / NAME
    folder.mkdir()
    for name, content in FILES.items():
        (folder / name).write_text(content, encoding="utf-8")
    encoder = Encoder(1, 1)
    texts = [Statustext(severity=3, text=TEXT, id=0, chunk_seq=0) for _ in range(3)]
    log = b"".join(record_bytes(at, encoder.encode(one)) for at, one in enumerate(texts))
    (folder / "r1.tlog").write_bytes(log)
    monkeypatch.chdir(tmp_path)
    return folder


@pytest.mark.parametrize("line", LINES)
def test_a_verb_lets_no_control_character_out(
    line: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Include the name of the folder in each argument that is a file."""
    words = [str(folder / word) if "." in word else word for word in line.split()]
    with suppress(SystemExit):
        sidestep.main(words)
    said = "".join(capsys.readouterr())
    assert said
    assert "internal error" not in said
    assert raw_in(said) == []
    assert OWNED in said
