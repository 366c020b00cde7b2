"""Control characters never reach a terminal, whatever the source of the text."""

import subprocess
import sys
from io import BytesIO, StringIO, TextIOWrapper
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.cli.terminal import CLEAR_LINE, guarded, guarded_output, printable, steer
from tests.support.each import each

ROOT = Path(__file__).parents[4]
HOSTILE = "\x00\x07\x08\x0b\x0c\r\x1b\x7f\x80\x85\x9b\x9d\xad\u061c\u200b\u200e\u200f\u2028\u2029"
HOSTILE += "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\ufeff\ud800\udcff\U000e0041"
CODE = """
import sys, types, importlib
sys.modules["ground.cli.main"] = hostile = types.ModuleType("hostile")
def main(arguments, ends_process):
    {does}
hostile.main = main
import sidestep
sys.exit(sidestep.main(sys.argv[1:]))
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
