"""`sidestep calibrate` writes its table and files, and refuses what it cannot use."""

import json
from pathlib import Path

import pytest

from robot.core.parameters import DEFAULTS
from robot.storage import Store
from runtime import config
from runtime.config import Calibration
from sidestep import main as sidestep
from study import calibration
from tests.support.each import each

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
