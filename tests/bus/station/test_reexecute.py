"""All that an operator can do in one run, recorded, and executed again from the recording."""

from pathlib import Path
from threading import Lock

from ground.recording.log_reader import open_log
from ground.recording.mcap_file import McapFormat
from protocol.topics import INPUTS, SONAR, WHEELS
from study.cli.reexecute import params_of, start_of
from study.trial.reexecution import RecordedDrive, reexecute, refuse_unless_whole
from tests.support.harness import Stack
from tests.support.operators import drive_about


def test_all_commands_and_lost_samples_are_reproduced(tmp_path: Path) -> None:
    form, lock, path = McapFormat("r1", {}), Lock(), tmp_path / "a.mcap"
    heard: set[str] = set()

    def take(key: str, frame: bytes, arrived_ns: int) -> None:
        heard.add(key)
        with lock:
            form.add(key, frame, 1_790_000_000_000_000 + arrived_ns // 1000)

    with Stack("box", noise="default", seed=4) as stack:
        stack.ground.stream_all(take)
        form.add_fact("parameters", stack.vehicle.parameters.described().decode())
        prefix = stack.ground.network.prefix
        needed = {topic.key("r1", prefix) for topic in (WHEELS, SONAR, INPUTS)}
        stack.until(lambda: needed <= heard, within_s=1.0)
        stack.forward(0.1)  # ticks recorded completely, before the first request
        drive_about(stack)
    with lock:
        path.write_bytes(form.end())
    recorded = RecordedDrive(open_log(path))
    refuse_unless_whole(recorded)
    start, _ = start_of(recorded)
    verdict = reexecute(recorded, params_of(recorded), start)
    assert verdict.first is None
    assert verdict.compared > 200, verdict.lack
    assert verdict.lack or verdict.compared == len(recorded.ticks), "a busy bus may drop a frame"
