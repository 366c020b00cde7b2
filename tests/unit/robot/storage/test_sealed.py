"""Saved state is read whole and unchanged, or not at all; and nothing holds up the start."""

import json
import os
from pathlib import Path
from tempfile import mkdtemp

import pytest

from protocol.wire.messages import ParamSet
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.file_writer import MAX_BYTES, sealed, text_in, unsealed
from robot.mission import text_of
from robot.storage import Store, own
from runtime.errors import UserError
from tests.support.each import each
from tests.support.robot.mission.items import circle, upload
from tests.support.robot.vehicles import Desk


def started(folder: Path) -> Desk:
    desk = Desk(Store(folder))
    desk.vehicle.restore()
    return desk


def test_no_flipped_bit_moves_the_fence(tmp_path: Path) -> None:
    assert upload(started(tmp_path), circle(0.0, 0.0, 3.0)).reason == Reason.NONE
    file = tmp_path / "fence.json"
    whole = file.read_bytes()
    right = started(tmp_path).vehicle.state.machine.fence
    refused = 0
    for bit in range(8 * len(whole)):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        desk = started(tmp_path)
        if desk.vehicle.state.machine.fence_unreadable:
            refused += 1
        else:
            assert desk.vehicle.state.machine.fence == right, bytes(flipped)
    file.write_bytes(whole.replace(b"3.0", b"9.0"))
    assert started(tmp_path).arm() == Reason.FENCE_UNREADABLE
    assert refused > 0.9 * 8 * len(whole)


def test_no_flipped_bit_changes_a_parameter(tmp_path: Path) -> None:
    desk = started(tmp_path)
    for name, value in (("d_obs_m", 0.45), ("max_speed_mps", 0.2)):
        desk.vehicle.receive(ParamSet(param_id=name, param_value=value, param_type=9), 0)
    file = tmp_path / "parameters.json"
    whole = file.read_bytes()
    right, _ = Store(tmp_path).load(DEFAULTS)
    assert right != DEFAULTS
    for bit in range(8 * len(whole)):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        params, warnings = Store(tmp_path).load(DEFAULTS)
        assert params == (DEFAULTS if warnings else right), bytes(flipped)


def test_files_of_earlier_versions_are_read(tmp_path: Path) -> None:
    (tmp_path / "fence.json").write_text(text_of(tuple(circle(0.0, 0.0, 3.0))))
    (tmp_path / "parameters.json").write_text(json.dumps({"d_obs_m": 0.45}))
    assert started(tmp_path).vehicle.state.machine.fence is not None
    params, warnings = Store(tmp_path).load(DEFAULTS)
    assert (params.d_obs_m, warnings) == (0.45, [])


@each("name", ["fence.json", "mission.json", "parameters.json", "life.txt", "robot.txt"])
@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_what_is_no_file_holds_up_no_start(kind: str, name: str, tmp_path: Path) -> None:
    folder = Path(mkdtemp(dir=tmp_path))
    if kind == "pipe":
        os.mkfifo(folder / name)
    elif kind == "device":
        os.symlink("/dev/zero", folder / name)
    else:
        (folder / name).write_bytes(b" " * (MAX_BYTES + 1))
    why = "larger than" if kind == "large" else "not a regular file"
    if name == "robot.txt":
        with pytest.raises(UserError, match=f"{name}: owner of the directory .* {why}"):
            own(folder, "r1")
        return
    _, warnings = Store(folder).load(DEFAULTS)
    desk = started(folder)
    told = "".join([*warnings, *desk.vehicle.restored])
    if name != "life.txt":
        assert str(folder / name) in told
        assert why in told
    assert (desk.arm() == Reason.NONE) == (name != "fence.json")


@each("text", ["[]", "{}", '{"a": [1, NaN, 1e300, "x"]}', "12345678901234567890"])
def test_sealed_value_is_the_value(text: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text(sealed(text))
    assert repr(unsealed(text_in(tmp_path / "file"))) == repr(unsealed(text))
