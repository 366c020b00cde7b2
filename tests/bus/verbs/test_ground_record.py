"""`record`, `router`, `watch` and `ground` until a signal ends them; `export` of what was kept."""

import json
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from ground.cli.main import main
from ground.recording.log_reader import open_log, read
from ground.recording.log_writer import LogFile
from ground.text.wording import StatustextAssembler
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import MARK, SONAR, Role
from protocol.wire.codec import decode
from protocol.wire.messages import Heartbeat, NavigatorStatus, Statustext
from tests.support.bus.robots import PlayedRobot, played
from tests.support.interrupt import interrupt_when
from tests.support.until import PATIENCE_S, until


@pytest.fixture
def stage() -> Iterator[tuple[PlayedRobot, str]]:
    with played() as found:
        yield found


def size_of(folder: Path) -> int:
    return sum(log.stat().st_size for log in folder.glob("*.tlog"))


def test_every_frame_is_kept_and_what_is_no_frame_is_not(
    stage: tuple[PlayedRobot, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, endpoint = stage
    noise = robot.bus.publisher(SONAR)

    def enough() -> bool:
        noise.put_frame(b"garbage")
        return size_of(tmp_path) > 3000

    interrupt_when(enough)
    assert main(["record", str(tmp_path), "--connect", endpoint, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    kept = [record.frame for record in read(Path(told["file"]))]
    frames = [decode(frame).message for frame in kept]
    assert told["frames"] == len(frames)
    assert told["rejected"] > 0
    log = open_log(Path(told["mcap"]))
    assert [one.frame for one in log] == kept
    assert log.damage() == ""
    assert "d_obs_m" in log.facts["parameters"]
    assert {type(frame) for frame in frames} >= {Heartbeat, NavigatorStatus}


def test_a_full_disk_is_shouted_and_ends_with_1(
    stage: tuple[PlayedRobot, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tries: list[int] = []

    def full(log: LogFile, batch: bytes) -> None:
        tries.append(len(batch))
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(LogFile, "append", full)
    interrupt_when(lambda: len(tries) > 2)
    assert main(["record", str(tmp_path), "--connect", stage[1]]) == 1
    said = capsys.readouterr()
    assert "RECORDING FAILS: No space left on device; the robot drives on" in said.err
    assert said.err.count("RECORDING FAILS") == 1, "reported once, not four times a second"
    assert "LOST" in said.out


def test_a_folder_that_cannot_be_made_is_refused(stage: tuple[PlayedRobot, str]) -> None:
    assert main(["record", "/proc/nowhere", "--connect", stage[1]]) == 2


def test_export_writes_a_table_and_reports_damage(
    tmp_path: Path, stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]
) -> None:
    interrupt_when(lambda: size_of(tmp_path) > 1000)
    main(["record", str(tmp_path), "--connect", stage[1]])
    (log,) = tmp_path.glob("*.tlog")
    capsys.readouterr()
    assert main(["export", str(log)]) == 0
    assert capsys.readouterr().out.startswith("time_s,utc_s,topic,message,field,value\n")
    log.write_bytes(log.read_bytes()[:-3])
    assert main(["export", str(log), "--out", str(tmp_path / "t.csv"), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["lost_bytes"] > 0


def test_mark_reaches_the_recorder(
    stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]
) -> None:
    heard: list[Statustext] = []

    def take(_key: str, frame: bytes, _at_ns: int) -> None:
        message = decode(frame).message
        assert isinstance(message, Statustext)
        heard.append(message)

    words = "a cart stands in the way, and it was not there before lunch"
    assert main(["mark", words, "--connect", stage[1]]) == 1
    assert "no recorder is running" in capsys.readouterr().out
    stage[0].bus.stream(MARK, take)
    assert main(["mark", *words.split(), "--connect", stage[1]]) == 0
    until(lambda: len(heard) == 2)
    texts = StatustextAssembler()
    assert [texts.receive(piece) for piece in heard] == ["", words]


def test_ground_is_an_operator_until_it_is_ended(
    stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]
) -> None:
    robot, endpoint = stage
    interrupt_when(lambda: robot.beats >= 3)
    assert main(["ground", "--connect", endpoint]) == 130
    said = capsys.readouterr().err
    assert robot.beats >= 3
    assert "STANDBY GUIDED NONE" in said


def test_watch_only_looks(
    stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]
) -> None:
    robot, endpoint = stage
    said: list[str] = []

    def shown() -> bool:
        said.extend(capsys.readouterr())
        return "STANDBY" in "".join(said)

    interrupt_when(shown, signal.SIGTERM)
    assert main(["watch", "--connect", endpoint]) == 143
    assert robot.beats == 0
    assert "Traceback" not in "".join((*said, *capsys.readouterr()))


def test_router_forwards_samples(capsys: pytest.CaptureFixture[str]) -> None:
    heard: list[bytes] = []

    def meet() -> bool:
        said = capsys.readouterr().err
        if "router at " not in said:
            return False
        network = Network(mode="client", connect=(said.split("router at ")[1].split()[0],))
        with (
            open_bus(network, Role.PLANT, "r1") as one,
            open_bus(network, Role.ROBOT, "r1") as two,
        ):
            two.stream(SONAR, lambda _key, frame, _at: heard.append(frame))
            publisher = one.publisher(SONAR)
            one.await_matched([publisher], timeout_s=PATIENCE_S)
            publisher.put_frame(b"hello")
            until(lambda: heard)
        return True

    interrupt_when(meet, signal.SIGTERM)
    assert main(["router", "--listen", "tcp/127.0.0.1:0"]) == 0
    assert heard == [b"hello"]
