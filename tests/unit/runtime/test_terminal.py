"""Control characters never reach a terminal, from texts, files or names of files."""

import json
import subprocess
import sys
from contextlib import suppress
from io import BytesIO, StringIO, TextIOWrapper
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.recording.log_reader import record_bytes
from protocol.wire.codec import Encoder
from protocol.wire.messages import Statustext
from runtime.cli.terminal import CLEAR_LINE, guarded, guarded_output, printable, steer
from sidestep.__main__ import main
from tests.support.each import each
from tests.support.hostile import OWNED, TEXT, raw_in

ROOT = Path(__file__).parents[3]
HOSTILE = "\x00\x07\x08\x0b\x0c\r\x1b\x7f\x80\x85\x9b\x9d\xad\u061c\u200b\u200e\u200f\u2028\u2029"
HOSTILE += "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\ufeff\ud800\udcff\U000e0041"
CODE = """
import sys, types, importlib
sys.modules["ground.cli.main"] = hostile = types.ModuleType("hostile")
def main(arguments, ends_process):
    {does}
hostile.main = main
from sidestep.__main__ import main
sys.exit(main(sys.argv[1:]))
"""
WORDS = r"'\x1b]0;OWNED\x07 \x9b2J \u202e \u2028 \ud800 end'"


@each("letter", HOSTILE)
def test_control_character_is_replaced(letter: str) -> None:
    out = StringIO()
    print(f"a{letter}b", file=guarded(out))
    assert out.getvalue() == "a?b\n"


def test_printable_text_is_unchanged() -> None:
    out = StringIO()
    print("Grüße, 世界 → 90°\n\tnext", file=guarded(out))
    assert out.getvalue() == "Grüße, 世界 → 90°\n next\n"


@given(st.text())
def test_length_is_kept_and_all_is_printable(text: str) -> None:
    found = printable(text)
    assert found.isprintable()
    assert len(found) == len(text)
    assert all(a == b or not a.isprintable() for a, b in zip(text, found, strict=True))


def test_only_own_sequences_pass_and_guards_are_not_nested() -> None:
    out = StringIO()
    steer(guarded(guarded(out)), CLEAR_LINE)
    assert out.getvalue() == CLEAR_LINE
    assert guarded(guarded(out)) is not out
    print(CLEAR_LINE, file=guarded(out))
    assert out.getvalue() == CLEAR_LINE + "??[K\n"


def test_standard_output_is_restored(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout, sys.stderr
    with guarded_output():
        print("\x1b[2J")
        print("\x1b[2J", file=sys.stderr)
    assert (sys.stdout, sys.stderr) == before
    assert capsys.readouterr() == ("?[2J\n", "?[2J\n")


@each(
    "does",
    [
        f"print({WORDS}); return 0",
        f"print({WORDS}, file=sys.stderr); return 0",
        f"raise RuntimeError({WORDS})",
        f"import argparse; argparse.ArgumentParser().error({WORDS})",
        f"import warnings; warnings.warn({WORDS}); return 0",
        "import threading\n"
        f"    thread = threading.Thread(target=lambda: int({WORDS}))\n"
        "    thread.start(); thread.join(); return 0",
    ],
)
@each("traceback", [[], ["--traceback"]])
def test_the_executable_lets_no_control_character_out(does: str, traceback: list[str]) -> None:
    """Includes a traceback of the interpreter, one of a thread, and an error of argparse."""
    command = [sys.executable, "-W", "default", "-c", CODE.format(does=does), *traceback, "up"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, check=False)
    said = (run.stdout + run.stderr).decode()
    assert "OWNED" in said
    assert "end" in said
    assert [letter for letter in said if letter != "\n" and not letter.isprintable()] == []


def test_closed_output_stays_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    with guarded_output():
        assert sys.stderr is None
        print("no reader", file=sys.stderr)


@each(
    ("encoding", "written"),
    [
        ("ascii", "turns 34 deg left ?"),
        ("latin-1", "turns 34 deg left ?"),
        ("utf-8", "turns 34° left ◎"),
    ],
)
def test_output_fits_the_encoding_of_the_stream(encoding: str, written: str) -> None:
    raw = BytesIO()
    stream = TextIOWrapper(raw, encoding=encoding)
    guarded(stream).write("turns 34° left ◎")
    stream.flush()
    assert raw.getvalue().decode(encoding) == written


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


@each("line", LINES)
def test_a_verb_lets_no_control_character_out(
    line: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Include the name of the folder in each argument that is a file."""
    words = [str(folder / word) if "." in word else word for word in line.split()]
    with suppress(SystemExit):
        main(words)
    said = "".join(capsys.readouterr())
    assert said
    assert "internal error" not in said
    assert raw_in(said) == []
    assert OWNED in said
