"""Calibration: its log, its fit, UMBmark, and the verb that writes its files."""

import json
from math import hypot, log, radians
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.parameters import DEFAULTS
from robot.core.values import Pose
from robot.parameter_table import OutOfRangeError, with_values
from robot.storage import Store
from runtime import config
from runtime.config import Calibration
from runtime.errors import ConfigError
from sidestep.__main__ import main as sidestep
from study import calibration
from study.calibration import (
    CCW,
    CW,
    Fit,
    SquareRun,
    believed,
    covariance_of,
    covariance_parts_of,
    fit_parameters,
    minimum,
    most_likely_k,
    umbmark,
    wheel_ratio,
)
from tests.support.each import each
from tests.support.studies import SIDE_M, squares

QUICK = ("calibrate", "--runs", "2", "--side", "1", "--noise", "none")


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert sidestep(["calibrate", *words]) == 2
    return capsys.readouterr().err.strip()


def test_wrong_track_is_corrected_and_stored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {name: tmp_path / name for name in ("found.toml", "runs.csv", "state", "plot.svg")}
    words = ["--param", "track_m=0.203", "--output", str(files["found.toml"])]
    words += ["--save-log", str(files["runs.csv"]), "--state", str(files["state"])]
    words += ["--plot", str(files["plot.svg"])]
    assert sidestep([*QUICK, *words]) == 0
    text = capsys.readouterr().out
    assert "E_max,syst, m" in text
    assert "track_m      0.203 -> " in text
    found = config.load(files["found.toml"], Calibration).parameters
    assert found["track_m"] == pytest.approx(0.2, abs=2e-5)
    assert files["found.toml"].read_text().startswith("# Made by: sidestep calibrate --runs 2")
    stored, warnings = Store(files["state"]).load(DEFAULTS)
    assert (stored.track_m, warnings) == (found["track_m"], [])
    assert len(calibration.read_log(files["runs.csv"])) == 4
    assert "<svg" in files["plot.svg"].read_text(encoding="utf-8")


def test_log_gives_the_same_result_as_the_drive(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "runs.csv"
    believed = ("--param", "wheel_ratio=1.004")
    assert sidestep([*QUICK, *believed, "--save-log", str(file), "--json"]) == 0
    driven = json.loads(capsys.readouterr().out)
    words = ("--log", str(file), "--side", "1", *believed, "--json")
    assert sidestep(["calibrate", *words]) == 0
    read = json.loads(capsys.readouterr().out)
    assert read["found"]["wheel_ratio"] == pytest.approx(1.0, abs=1e-5)
    assert read["found"]["wheel_ratio"] == pytest.approx(driven["found"]["wheel_ratio"], abs=1e-6)
    assert driven["unslipped_before_m"] > 10.0 * driven["unslipped_after_m"]
    assert read["unslipped_before_m"] is None
    output = tmp_path / "no" / "found.toml"
    assert f"{output}: cannot be written" in refused(capsys, *words, "--output", str(output))


def test_result_depends_on_the_seed_only(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def found(seed: str) -> str:
        words = ("calibrate", "--runs", "2", "--side", "0.5", "--seed", seed, "--json")
        assert sidestep(list(words)) == 0
        return capsys.readouterr().out

    assert found("1") == found("1") != found("2")


def test_invalid_options_are_refused_before_driving(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "nothing.csv"
    assert f"{missing}: no such file" in refused(capsys, "--log", str(missing))
    assert "name a file that ends in .svg or .png" in refused(capsys, "--plot", "plot.pdf")
    assert "leave one of them out" in refused(capsys, "--log", "a", "--save-log", "b")
    assert "there is no parameter «trak»" in refused(capsys, "--param", "trak=1")


def test_impossible_runs_are_refused_with_advice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "runs.csv"
    lines = [",".join(calibration.COLUMNS)]
    for number, way in enumerate(("cw", "cw", "ccw", "ccw")):
        ticks = range(0, 4000, 100)
        lines += [f"{number},{way},{k},{k},,," for k in ticks]
        lines.append(f"{number},{way},4000,4000,900,-900,90")
    file.write_text("\n".join(lines), encoding="utf-8")
    assert "these runs fit no robot" in refused(capsys, "--log", str(file))


@each("words", [("--runs", "1"), ("--side", "x"), ("--noise", "gale")])
def test_wrong_usage_is_refused(words: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as end:
        sidestep(["calibrate", *words])
    assert end.value.code == 2


@given(st.floats(-20.0, 5.0))
def test_minimum_of_a_unimodal_function_is_found(bottom: float) -> None:
    found = minimum(lambda x: (log(x) - bottom) ** 2, 1e-10, 1e4)
    assert log(found) == pytest.approx(bottom, abs=1e-5)


def test_fit_is_exact_without_slip() -> None:
    truth = {"wheel_ratio": 1.005, "track_m": 0.202}
    fit = fit_parameters(squares(truth, 2), DEFAULTS)
    assert fit.value["wheel_ratio"] == pytest.approx(1.005, abs=1e-7)
    assert fit.value["track_m"] == pytest.approx(0.202, abs=1e-7)
    assert fit.value["k_r_m"] == fit.value["k_l_m"] == 0.0


def test_fit_with_slip_is_within_its_errors() -> None:
    truth = {"wheel_ratio": 1.005, "track_m": 0.201}
    fit = fit_parameters(squares(truth, 15, slip_m=2e-5, seed=4), DEFAULTS)
    for name, value in (*truth.items(), ("k_r_m", 2e-5), ("k_l_m", 2e-5)):
        assert abs(fit.value[name] - value) < 3.0 * fit.error[name]
    assert fit.error["wheel_ratio"] < 5e-4
    assert set(fit.adopted(DEFAULTS)) >= {"wheel_ratio", "k_r_m", "k_l_m"}


def test_insignificant_changes_are_not_adopted() -> None:
    fit = fit_parameters(squares({}, 15, slip_m=2e-6, seed=2), DEFAULTS)
    assert fit.adopted(DEFAULTS) == {}


@each("k_m", [1e-7, 2e-6, 3e-5])
def test_most_likely_k_matches_simulated_errors(k_m: float) -> None:
    spreads = covariance_parts_of(squares({}, 20), DEFAULTS)
    rng = np.random.default_rng(8)
    drawn = [rng.multivariate_normal(np.zeros(3), one) for one in spreads.covariance(k_m)]
    assert most_likely_k(np.array(drawn), spreads) == pytest.approx(k_m, rel=0.3)


def test_covariance_parts_add_up_to_that_of_the_core() -> None:
    runs = squares({}, 1)
    covariance = covariance_parts_of(runs, DEFAULTS).covariance(3e-6)
    params = with_values(DEFAULTS, {"k_r_m": 3e-6, "k_l_m": 3e-6})
    for one, run in zip(covariance, runs, strict=True):
        assert one == pytest.approx(covariance_of(believed(run, params)), rel=2e-3, abs=1e-9)


def test_impossible_runs_raise_an_error() -> None:
    runs = [
        SquareRun(direction=run.direction, ticks=run.ticks, measured=run.measured._replace(x_m=9e3))
        for run in squares({}, 2)
    ]
    with pytest.raises(OutOfRangeError):
        fit_parameters(runs, DEFAULTS)


@each(("k_m", "set_"), [(1.4e-6, False), (1.1e-6, True), (3.5e-6, True)])
def test_k_changes_only_when_significantly_different(k_m: float, set_: bool) -> None:
    relative = 0.13
    value = {"wheel_ratio": 1.0, "track_m": 0.2, "k_r_m": k_m, "k_l_m": k_m}
    error = {"wheel_ratio": 1e-4, "track_m": 1e-4, "k_r_m": relative * k_m, "k_l_m": relative * k_m}
    assert ("k_r_m" in Fit(value=value, error=error).adopted(DEFAULTS)) is set_


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


def test_log_of_a_spreadsheet_with_decimal_commas_is_read(tmp_path: Path) -> None:
    text = (HEAD + GOOD).replace(",", ";").replace(".", ",").replace("\n", "\r\n")
    found = calibration.read_log(written(tmp_path, f"\ufeff{text}"))
    assert found == calibration.read_log(written(tmp_path, HEAD + GOOD))


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


@each(
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


def test_correct_parameters_give_no_error() -> None:
    mark = umbmark(squares({}, 1), DEFAULTS, SIDE_M)
    assert mark.largest_m == pytest.approx(0.0, abs=1e-9)
    assert mark.wheel_ratio == pytest.approx(1.0)
    assert mark.track_ratio == pytest.approx(1.0)


@each("ratio", [0.996, 0.999, 1.001, 1.005])
def test_wheel_ratio_is_within_15_percent(ratio: float) -> None:
    mark = umbmark(squares({"wheel_ratio": ratio}, 1), DEFAULTS, SIDE_M)
    assert mark.wheel_ratio - 1.0 == pytest.approx(ratio - 1.0, rel=0.15)
    assert mark.track_ratio == pytest.approx(1.0, abs=0.8 * abs(ratio - 1.0))


@each("track_m", [0.198, 0.1995, 0.2005, 0.203])
def test_track_ratio_is_within_10_percent(track_m: float) -> None:
    mark = umbmark(squares({"track_m": track_m}, 1), DEFAULTS, SIDE_M)
    assert mark.track_ratio - 1.0 == pytest.approx(track_m / 0.2 - 1.0, rel=0.1)
    assert mark.wheel_ratio == pytest.approx(1.0, abs=1e-4)


def test_centres_agree_with_the_small_angle_formula() -> None:
    """Bend sides by b to the left: ccw returns by 2 L b in x, -y, cw by -2 L b in x, y."""
    ratio = 1.0005
    bent_rad = (ratio - 1.0) * SIDE_M / DEFAULTS.track_m
    mark = umbmark(squares({"wheel_ratio": ratio}, 1), DEFAULTS, SIDE_M)
    way_m = 2.0 * SIDE_M * bent_rad
    assert mark.ccw_m == pytest.approx((way_m, -way_m), rel=0.1)
    assert mark.cw_m == pytest.approx((-way_m, -way_m), rel=0.1)
    assert mark.largest_m == max(hypot(*mark.cw_m), hypot(*mark.ccw_m))


def test_true_parameters_remove_the_error() -> None:
    truth = {"wheel_ratio": 1.006, "track_m": 0.203}
    runs = squares(truth, 1)
    assert umbmark(runs, DEFAULTS, SIDE_M).largest_m > 0.5
    assert umbmark(runs, with_values(DEFAULTS, truth), SIDE_M).largest_m < 1e-9


def test_straight_side_means_equal_wheels() -> None:
    assert wheel_ratio(0.0, 4.0, 0.2) == 1.0
    assert wheel_ratio(0.1, 4.0, 0.2) * wheel_ratio(-0.1, 4.0, 0.2) == pytest.approx(1.0)


def test_squares_are_driven_in_both_directions() -> None:
    directions = [run.direction for run in squares({}, 2)]
    assert directions == [CW, CW, CCW, CCW]
