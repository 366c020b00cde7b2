"""A reader that closes the pipe early ends the verb silently with exit code 141."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ground.recording.log_reader import record_bytes
from protocol.wire.codec import Encoder
from tests.support.bus.robots import BEAT, played
from tests.support.until import PATIENCE_S

ROOT = Path(__file__).parents[3]
BROKEN_PIPE = 141
START_US = 1_790_000_000_000_000


def read_one_line_of(*words: str, both: bool = False) -> tuple[str, int, str]:
    """Return the first line, the exit code after the pipe closes, and standard error."""
    error = subprocess.STDOUT if both else subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, str(ROOT / "sidestep.py"), *words],
        stdout=subprocess.PIPE,
        stderr=error,
        text=True,
    ) as verb:
        assert verb.stdout is not None
        line = verb.stdout.readline()
        verb.stdout.close()
        said = "" if verb.stderr is None else verb.stderr.read()
        return line, verb.wait(timeout=PATIENCE_S), said


def test_head_of_a_table_exits_with_broken_pipe(tmp_path: Path) -> None:
    encoder = Encoder(1, 1)
    log = tmp_path / "x.tlog"
    log.write_bytes(b"".join(record_bytes(START_US, encoder.encode(BEAT)) for _ in range(20_000)))
    assert read_one_line_of("rec", "export", str(log)) == (
        "time_s,utc_s,topic,message,field,value\n",
        BROKEN_PIPE,
        "",
    )


@pytest.mark.parametrize("both", [False, True])
def test_head_of_watch_output_exits_with_broken_pipe(both: bool) -> None:
    with played() as (_, endpoint):
        line, code, said = read_one_line_of("watch", "--connect", endpoint, both=both)
    assert "STANDBY" in line
    assert (code, said) == (BROKEN_PIPE, "")


@pytest.mark.parametrize("words", [("param", "list"), ("watch", "--once")])
def test_reader_closed_before_output_gives_broken_pipe(words: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with played() as (_, endpoint):
        done = subprocess.run(
            [sys.executable, str(ROOT / "sidestep.py"), *words, "--connect", endpoint],
            stdout=writer,
            stderr=subprocess.PIPE,
            check=False,
            timeout=PATIENCE_S,
        )
    os.close(writer)
    assert (done.returncode, done.stderr) == (BROKEN_PIPE, b"")
