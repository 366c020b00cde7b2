from math import radians
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.values import Pose
from runtime.errors import ConfigError
from study import calibration
from study.calibration import CCW, CW, SquareRun

HEAD = "run,direction,left,right,x_m,y_m,heading_deg\n"
GOOD = "".join(
    f"{run},{way},0,0,,,\n{run},{way},100,100,0.01,-0.02,1.5\n"
    for run, way in ((1, "cw"), (2, "cw"), (3, "ccw"), (4, "ccw"))
)


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "runs.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_log_is_read(tmp_path: Path) -> None:
    runs = calibration.read_log(written(tmp_path, HEAD + GOOD))
    assert [run.direction for run in runs] == [CW, CW, CCW, CCW]
    assert runs[0].ticks == [(0, 0), (100, 100)]
    assert runs[0].measured == pytest.approx((0.01, -0.02, radians(1.5)))


counters = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1))
places = st.floats(-50.0, 50.0)


@given(st.lists(counters, min_size=2, max_size=6), places, places, st.floats(-3.1, 3.1))
def test_written_log_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    ticks: list[tuple[int, int]],
    x_m: float,
    y_m: float,
    heading_rad: float,
) -> None:
    file = tmp_path_factory.mktemp("log") / "runs.csv"
    ticks[-1] = (ticks[0][0] ^ 1, ticks[-1][1])
    runs = [
        SquareRun(direction=way, ticks=ticks, measured=Pose(x_m, y_m, heading_rad))
        for way in (CW, CW, CCW, CCW)
    ]
    calibration.write_log(file, runs)
    for old, new in zip(runs, calibration.read_log(file), strict=True):
        assert new.ticks == old.ticks
        assert new.measured == pytest.approx(old.measured, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: has the columns none; begin with run,direction,left"),
        ("a,b\n1,2\n", "line 1: has the columns a,b"),
        (HEAD, "has 0 runs cw; drive at least 2, better 20, in each direction"),
        (HEAD + "1,cw,0\n", "line 2: has 3 fields; write 7"),
        (HEAD + "1,left,0,0,,,\n", "line 2: direction: 'left' is not a direction; write cw or ccw"),
        (HEAD + "1,cw,0,1.5,,,\n", "line 2: right: '1.5' is not a whole number"),
        (HEAD + "1,cw,0,0,,,\n1,cw,9,9,0,,1\n", "line 3: y_m: '' is not a number"),
        (HEAD + "1,cw,0,0,,,\n1,cw,9,9,0,nan,1\n", "line 3: y_m: 'nan' is not a number"),
        (HEAD + "1,cw,0,0,,,\n1,cw,9,9,,,\n", "line 3: ends run 1 without a measured pose"),
        (HEAD + "1,cw,0,0,0,0,0\n1,cw,9,9,0,0,0\n", "line 2: has a pose in the middle of a run"),
        (HEAD + "1,cw,5,5,0,0,0\n", "line 2: ends run 1, which did not move"),
        (HEAD + "1,cw,0,0,,,\n1,ccw,9,9,0,0,0\n", "line 3: run 1 has both directions"),
        (HEAD + GOOD.partition("4,ccw")[0], "has 1 runs ccw"),
    ],
)
def test_bad_log_is_refused_with_line_and_advice(tmp_path: Path, text: str, message: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(ConfigError) as refusal:
        calibration.read_log(file)
    assert str(refusal.value).startswith(f"{file}: {message}")


def test_missing_or_binary_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        calibration.read_log(tmp_path / "none.csv")
    file = tmp_path / "noise.csv"
    file.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ConfigError, match="is not CSV text"):
        calibration.read_log(file)
