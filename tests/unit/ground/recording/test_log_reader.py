"""Both formats give the same frames, whole or truncated, and report losses."""

import os
import random
from pathlib import Path

import pytest

from ground.recording.log_reader import LoggedFrame, key_of, open_log, robot_in
from ground.recording.mcap_file import McapFormat
from protocol.wire.codec import Encoder
from protocol.wire.messages import Heartbeat, MissionCurrent, ParamRequestList
from runtime.errors import UserError
from tests.support.ground.recording.made import PublishedFrame, mcap, mcap_of_before, run, tlog


@pytest.fixture
def frames_sent() -> list[PublishedFrame]:
    return list(run(12))


def as_frames(frames_sent: list[PublishedFrame]) -> list[LoggedFrame]:
    return [LoggedFrame(one.time_us * 1000, one.key, one.frame) for one in frames_sent]


def test_both_formats_give_the_same_frames(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    assert list(open_log(tlog(tmp_path / "a.tlog", frames_sent))) == as_frames(frames_sent)
    assert list(open_log(mcap(tmp_path / "a.mcap", frames_sent))) == as_frames(frames_sent)


def test_older_mcap_gives_the_same_frames(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    log = open_log(mcap_of_before(tmp_path / "a.mcap", frames_sent))
    assert list(log) == as_frames(frames_sent)
    assert log.damage() == ""


def test_keys_that_cannot_be_derived_are_kept(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    """Keep keys of operator sessions and of anything outside the topics."""
    odd = [
        one._replace(key=f"sidestep/r1/op/beat/ada/{number % 3:x}") if number % 2 else one
        for number, one in enumerate(frames_sent)
    ]
    log = open_log(mcap(tmp_path / "a.mcap", odd, every=3))
    assert list(log) == as_frames(odd)


def test_key_is_not_carried_over_a_damaged_chunk(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    """Do not assign the key of a lost frame to the next one."""
    form = McapFormat("r1", {})
    form.add(frames_sent[0].key, frames_sent[0].frame, frames_sent[0].time_us)
    begin = form.batch()
    form.add("sidestep/r1/op/beat/ada/1", frames_sent[1].frame, frames_sent[1].time_us)
    torn = bytearray(form.batch())
    torn[100] ^= 1
    form.add(frames_sent[2].key, frames_sent[2].frame, frames_sent[2].time_us)
    form.add("sidestep/r1/op/beat/ada/1", frames_sent[3].frame, frames_sent[3].time_us)
    path = tmp_path / "a.mcap"
    path.write_bytes(begin + torn + form.end())
    log = open_log(path)
    first, _, third, fourth = as_frames(frames_sent)[:4]
    assert list(log) == [first, third, fourth._replace(key="sidestep/r1/op/beat/ada/1")]
    assert log.damage()


def test_whole_file_has_no_damage_and_has_its_world(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    log = open_log(mcap(tmp_path / "a.mcap", frames_sent))
    assert len(list(log)) == log.records == len(frames_sent)
    assert log.damage() == ""
    assert '"name": "made"' in log.facts["world"]


def test_truncated_mcap_yields_the_frames_before_the_cut(tmp_path: Path) -> None:
    expected, path = as_frames(list(run(2))), tmp_path / "cut.mcap"
    size = mcap(path, list(run(2)), every=5).stat().st_size
    most = len(expected)
    while size > 0:
        size -= 101 if most == len(expected) else 1  # the index at the end is not read here
        os.truncate(path, max(0, size))
        log = open_log(path)
        found = list(log)
        assert found == expected[: len(found)]
        assert len(found) <= most, "a shorter file never gives more"
        most = len(found)
        assert most == len(expected) or log.damage(), "a truncated file reports damage"
    assert most == 0


def test_damage_counts_the_unusable_bytes(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    path = mcap(tmp_path / "a.mcap", frames_sent, every=7, closed=False)
    whole = path.read_bytes()
    lost = {}
    for cut in (1, 2, 3):
        path.write_bytes(whole[:-cut])
        log = open_log(path)
        list(log)
        lost[cut] = log.lost_bytes
    assert lost[1] > 3
    assert lost[1] - lost[2] == lost[2] - lost[3] == 1


def test_flipped_byte_loses_at_most_one_chunk(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    path = mcap(tmp_path / "a.mcap", frames_sent, every=7)
    whole, expected, luck = path.read_bytes(), as_frames(frames_sent), random.Random(5)
    for _ in range(300):
        place = luck.randrange(8, len(whole))
        broken = bytearray(whole)
        broken[place] ^= 1 << luck.randrange(8)
        path.write_bytes(broken)
        log = open_log(path)
        assert all(frame in expected for frame in log)
        log.damage()


def test_noise_is_read_without_exception(tmp_path: Path) -> None:
    luck, path = random.Random(9), tmp_path / "noise.mcap"
    for _ in range(200):
        noise = luck.randbytes(luck.randrange(200))
        for begin in (b"", b"\x89MCAP0\r\n"):
            path.write_bytes(begin + noise)
            log = open_log(path)
            assert list(log) == []
            assert log.damage() or not begin + noise


def test_missing_file_is_a_user_error(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="No such file"):
        open_log(tmp_path / "none.tlog")
    with pytest.raises(UserError, match="not a regular file: name a recording"):
        open_log(tmp_path)


def test_file_name_contains_the_robot() -> None:
    assert robot_in(Path("20260304T120005Z-r7.tlog")) == "r7"
    assert robot_in(Path("20260304T120005Z-r7.1.mcap")) == "r7", "second file of the same second"
    assert robot_in(Path("20260304T120005Z-r-1.tlog")) == "r-1"
    assert robot_in(Path("20260304T120005Z-left-arm.mcap")) == "left-arm"
    assert robot_in(Path("mine.tlog")) == "r1"


def test_tlog_distinguishes_the_heartbeats() -> None:
    beat = Heartbeat(
        type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3
    )
    assert key_of(Encoder(3, 1).encode(beat), "r3") == "sidestep/r3/tlm/heartbeat"
    assert key_of(Encoder(255, 190).encode(beat), "r3") == "sidestep/r3/op/heartbeat"


def test_message_without_topic_has_an_unknown_key() -> None:
    frame = Encoder(1, 77).encode(ParamRequestList(target_system=1, target_component=1))
    assert key_of(frame, "r1") == "sidestep/r1/unknown/param_request_list"
    frame = Encoder(1, 77).encode(MissionCurrent(seq=1, total=2, mission_state=0, mission_mode=0))
    assert key_of(frame, "r1").startswith("sidestep/r1/unknown/")


def test_renamed_file_and_other_prefix_keep_the_robot(
    tmp_path: Path,
) -> None:
    form = McapFormat("r7", {})
    for one in run(2, "r7"):
        form.add(one.key.replace("sidestep/", "yard/north/"), one.frame, one.time_us)
    path = tmp_path / "the one with the cart.mcap"
    path.write_bytes(form.end())
    log = open_log(path)
    assert log.robot == "r7"
    assert [frame.key for frame in log] == [one.key for one in run(2, "r7")]
    assert open_log(path, "r9").robot == "r9"
