"""Either file of a run gives the same frames, whole or cut, and says what was lost."""

import os
import random
from pathlib import Path

import pytest

from ground.recording.log_reader import Frame, frames, key_of, opened, robot_in
from ground.recording.mcap.writer import McapFormat
from protocol.wire.codec import Encoder
from protocol.wire.messages import Heartbeat, MissionCurrent, ParamRequestList
from runtime.errors import UserError
from tests.support.ground.recording.made import Said, mcap, mcap_of_before, run, tlog


@pytest.fixture
def said() -> list[Said]:
    return list(run(12))


def as_frames(said: list[Said]) -> list[Frame]:
    return [Frame(one.time_us * 1000, one.key, one.frame) for one in said]


def test_both_files_give_the_same_frames_keys_and_times(tmp_path: Path, said: list[Said]) -> None:
    assert list(frames(tlog(tmp_path / "a.tlog", said))) == as_frames(said)
    assert list(frames(mcap(tmp_path / "a.mcap", said))) == as_frames(said)


def test_a_file_of_an_earlier_version_gives_the_same(tmp_path: Path, said: list[Said]) -> None:
    log = opened(mcap_of_before(tmp_path / "a.mcap", said))
    assert list(log) == as_frames(said)
    assert log.damage() == ""


def test_keys_that_a_frame_does_not_tell_are_kept(tmp_path: Path, said: list[Said]) -> None:
    """Sessions of operators, and whatever else is published beside the topics."""
    odd = [
        one._replace(key=f"sidestep/r1/op/beat/ada/{number % 3:x}") if number % 2 else one
        for number, one in enumerate(said)
    ]
    log = opened(mcap(tmp_path / "a.mcap", odd, every=3))
    assert list(log) == as_frames(odd)


def test_a_key_is_not_taken_over_a_damaged_chunk(tmp_path: Path, said: list[Said]) -> None:
    """The key of a lost frame must not go to the next one."""
    form = McapFormat("r1", {})
    form.add(said[0].key, said[0].frame, said[0].time_us)
    begin = form.batch()
    form.add("sidestep/r1/op/beat/ada/1", said[1].frame, said[1].time_us)
    torn = bytearray(form.batch())
    torn[100] ^= 1
    form.add(said[2].key, said[2].frame, said[2].time_us)
    form.add("sidestep/r1/op/beat/ada/1", said[3].frame, said[3].time_us)
    path = tmp_path / "a.mcap"
    path.write_bytes(begin + torn + form.end())
    log = opened(path)
    first, _, third, fourth = as_frames(said)[:4]
    assert list(log) == [first, third, fourth._replace(key="sidestep/r1/op/beat/ada/1")]
    assert log.damage()


def test_a_whole_file_has_no_damage_and_knows_its_world(tmp_path: Path, said: list[Said]) -> None:
    log = opened(mcap(tmp_path / "a.mcap", said))
    assert len(list(log)) == log.records == len(said)
    assert log.damage() == ""
    assert '"name": "made"' in log.facts["world"]


def test_cut_at_every_byte_the_frames_before_the_cut_are_there(tmp_path: Path) -> None:
    expected, path = as_frames(list(run(2))), tmp_path / "cut.mcap"
    size = mcap(path, list(run(2)), every=5).stat().st_size
    most = len(expected)
    while size > 0:
        size -= 101 if most == len(expected) else 1  # at the end is the index, not read here
        os.truncate(path, max(0, size))
        log = opened(path)
        found = list(log)
        assert found == expected[: len(found)]
        assert len(found) <= most, "a shorter piece never gives more"
        most = len(found)
        assert most == len(expected) or log.damage(), "it is never passed off as a whole file"
    assert most == 0


def test_a_cut_names_exactly_the_bytes_that_are_of_no_use(tmp_path: Path, said: list[Said]) -> None:
    path = mcap(tmp_path / "a.mcap", said, every=7, closed=False)
    whole = path.read_bytes()
    lost = {}
    for cut in (1, 2, 3):
        path.write_bytes(whole[:-cut])
        log = opened(path)
        list(log)
        lost[cut] = log.lost_bytes
    assert lost[1] > 3
    assert lost[1] - lost[2] == lost[2] - lost[3] == 1


def test_a_flipped_byte_costs_at_most_its_own_chunk(tmp_path: Path, said: list[Said]) -> None:
    path = mcap(tmp_path / "a.mcap", said, every=7)
    whole, expected, luck = path.read_bytes(), as_frames(said), random.Random(5)
    for _ in range(300):
        place = luck.randrange(8, len(whole))
        broken = bytearray(whole)
        broken[place] ^= 1 << luck.randrange(8)
        path.write_bytes(broken)
        log = opened(path)
        assert all(frame in expected for frame in log)
        log.damage()


def test_anything_at_all_is_read_without_an_accident(tmp_path: Path) -> None:
    luck, path = random.Random(9), tmp_path / "noise.mcap"
    for _ in range(200):
        noise = luck.randbytes(luck.randrange(200))
        for begin in (b"", b"\x89MCAP0\r\n"):
            path.write_bytes(begin + noise)
            log = opened(path)
            assert list(log) == []
            assert log.damage() or not begin + noise


def test_a_file_that_is_not_there_is_the_users_mistake(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="No such file"):
        opened(tmp_path / "none.tlog")
    with pytest.raises(UserError, match="directory"):
        opened(tmp_path)


def test_the_robot_is_in_the_name_of_the_file() -> None:
    assert robot_in(Path("20260304T120005Z-r7.tlog")) == "r7"
    assert robot_in(Path("20260304T120005Z-r7.1.mcap")) == "r7", "another of that second"
    assert robot_in(Path("20260304T120005Z-r-1.tlog")) == "r-1"
    assert robot_in(Path("20260304T120005Z-left-arm.mcap")) == "left-arm"
    assert robot_in(Path("mine.tlog")) == "r1"


def test_a_tlog_tells_the_robots_heartbeat_from_the_operators() -> None:
    beat = Heartbeat(
        type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3
    )
    assert key_of(Encoder(3, 1).encode(beat), "r3") == "sidestep/r3/tlm/heartbeat"
    assert key_of(Encoder(255, 190).encode(beat), "r3") == "sidestep/r3/op/heartbeat"


def test_what_is_on_no_topic_has_a_key_that_says_so() -> None:
    frame = Encoder(1, 77).encode(ParamRequestList(target_system=1, target_component=1))
    assert key_of(frame, "r1") == "sidestep/r1/unknown/param_request_list"
    frame = Encoder(1, 77).encode(MissionCurrent(seq=1, total=2, mission_state=0, mission_mode=0))
    assert key_of(frame, "r1").startswith("sidestep/r1/unknown/")


def test_a_renamed_file_still_knows_its_robot_and_another_prefix_is_no_matter(
    tmp_path: Path,
) -> None:
    form = McapFormat("r7", {})
    for one in run(2, "r7"):
        form.add(one.key.replace("sidestep/", "yard/north/"), one.frame, one.time_us)
    path = tmp_path / "the one with the cart.mcap"
    path.write_bytes(form.end())
    log = opened(path)
    assert log.robot == "r7"
    assert [frame.key for frame in log] == [one.key for one in run(2, "r7")]
    assert opened(path, "r9").robot == "r9"
