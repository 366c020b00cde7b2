"""pymavlink's own tool reads a black box, as docs/how-to/recordings.md describes."""

import shutil
import subprocess
import sys
from pathlib import Path

import pymavlink
import pytest

from ground.recording.log_reader import record_bytes
from protocol.wire.codec import Encoder
from protocol.wire.messages import SonarScan, Statustext, WheelTicks

pytestmark = pytest.mark.stack

ROOT = Path(__file__).parents[3]
INSTALLED = Path(pymavlink.__file__).parent
START_US = 1_763_700_000_000_000


@pytest.fixture
def borrowed(tmp_path: Path) -> Path:
    """Copy pymavlink to a writable folder and add our dialect."""
    package = tmp_path / "pymavlink"
    package.mkdir()
    for path in (*INSTALLED.glob("*.py"), *INSTALLED.glob("*.so")):
        shutil.copy(path, package)
    shutil.copytree(INSTALLED / "generator", package / "generator")
    dialects = package / "dialects" / "v20"
    dialects.mkdir(parents=True)
    shutil.copy(INSTALLED / "dialects" / "__init__.py", dialects.parent)
    for name in ("__init__.py", "all.py", "common.xml", "standard.xml", "minimal.xml"):
        shutil.copy(INSTALLED / "dialects" / "v20" / name, dialects)
    shutil.copy(ROOT / "protocol" / "dialect" / "sidestep.xml", dialects)
    return tmp_path


def test_every_record_is_read_with_its_time_and_its_fields(borrowed: Path) -> None:
    encoder = Encoder(1, 1)
    ranges_mm = (100, 200, 300, 400, 500, 600, 700, 800)
    messages = [
        WheelTicks(time_ns=50_000_000, seq=1, left=-7, right=7, bumper=0, expired=0),
        SonarScan(
            time_ns=50_000_000,
            seq=1,
            range_mm=ranges_mm,
            ping_age_us=(0,) * 8,
            valid=255,
            echo=255,
        ),
        Statustext(severity=6, text="ready", id=0, chunk_seq=0),
    ]
    log = borrowed / "run.tlog"
    records = (record_bytes(START_US, encoder.encode(message)) for message in messages)
    log.write_bytes(b"".join(records))
    tool = Path(sys.executable).with_name("mavlogdump.py")
    run = subprocess.run(
        [sys.executable, str(tool), "--dialect", "sidestep", str(log)],
        env={"PYTHONPATH": str(borrowed), "MAVLINK20": "1", "TZ": "UTC"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    assert len(lines) == len(messages)
    assert "WHEEL_TICKS {time_ns : 50000000, seq : 1, left : -7, right : 7" in lines[0]
    assert lines[0].startswith("2025-11-21 04:40:00.00")
    assert f"range_mm : {list(ranges_mm)}" in lines[1]
    assert "text : ready" in lines[2]
