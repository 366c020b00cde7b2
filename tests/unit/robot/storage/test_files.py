from pathlib import Path

import pytest

from protocol.wire.enums import PARAM_TYPE_REAL32
from protocol.wire.messages import CommandAck, ParamSet
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.emergency_stop import emergency_stop
from robot.storage import FILE_NAME, Store
from tests.support.robot.vehicles import Desk


def test_what_was_saved_is_in_force_after_a_restart(tmp_path: Path) -> None:
    Store(tmp_path / "state").save("d_obs_m", 0.45)
    params, warnings = Store(tmp_path / "state").load(DEFAULTS)
    assert params.d_obs_m == 0.45
    assert warnings == []


def test_saving_a_second_value_keeps_the_first(tmp_path: Path) -> None:
    Store(tmp_path).save("d_obs_m", 0.45)
    store = Store(tmp_path)
    store.load(DEFAULTS)
    store.save("side", -1)
    params, _ = Store(tmp_path).load(DEFAULTS)
    assert (params.d_obs_m, params.side) == (0.45, -1)


def test_without_a_directory_nothing_is_kept() -> None:
    store = Store(None)
    store.save("d_obs_m", 0.45)
    assert store.load(DEFAULTS) == (DEFAULTS, [])


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null", '"x"', "\x00"])
def test_broken_file_leaves_the_defaults_with_a_warning(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE_NAME).write_text(text)
    params, warnings = Store(tmp_path).load(DEFAULTS)
    assert params == DEFAULTS
    assert len(warnings) == 1
    assert FILE_NAME in warnings[0]


def test_a_bad_value_is_left_out_by_name_and_the_rest_is_used(tmp_path: Path) -> None:
    text = '{"d_obs_m": 99, "nonsense": 1, "side": "left", "v_max_m_s": 0.2}'
    (tmp_path / FILE_NAME).write_text(text)
    params, warnings = Store(tmp_path).load(DEFAULTS)
    assert params.v_max_m_s == 0.2
    assert params.d_obs_m == DEFAULTS.d_obs_m
    assert [name for name in ("d_obs_m", "nonsense", "side") if name in " ".join(warnings)] == [
        "d_obs_m",
        "nonsense",
        "side",
    ]


def written(folder: Path, text: str) -> Store:
    (folder / FILE_NAME).write_text(text)
    return Store(folder)


@pytest.mark.parametrize(
    ("text", "lost"),
    [
        ("{", "parameters.json"),
        ('{"crc32": "00000000", "saved": {"side": 1}}', "checksum"),
        ('{"guard_stop_m": 99}', "guard_stop_m"),
        ('{"op_lost_ms": "soon", "side": 1}', "op_lost_ms"),
        ('{"v_max_m_s": null}', "v_max_m_s"),
    ],
)
def test_damaged_safety_parameters_forbid_arming_until_one_is_set(
    tmp_path: Path, text: str, lost: str
) -> None:
    store = written(tmp_path, text)
    _, warnings = store.load(DEFAULTS, DEFAULTS)
    (warning,) = warnings
    assert lost in warning
    assert "arming is refused until a safety parameter is set" in warning
    desk = Desk(store)
    assert desk.arm() == Reason.PARAMETERS_DAMAGED
    assert set_to(desk, "side", DEFAULTS.side) == Reason.NONE
    assert desk.arm() == Reason.PARAMETERS_DAMAGED, "it does not concern safety"
    assert set_to(desk, "guard_stop_m", DEFAULTS.guard_stop_m) == Reason.NONE
    assert desk.arm() == Reason.NONE
    again = Store(tmp_path)
    assert again.load(DEFAULTS, DEFAULTS)[1] == []
    assert not again.damaged


def set_to(desk: Desk, name: str, value: float) -> int:
    answer = desk.vehicle.receive(
        ParamSet(param_id=name, param_value=value, param_type=PARAM_TYPE_REAL32), desk.now_ns
    )
    return answer.result_param2 if isinstance(answer, CommandAck) else Reason.NONE


@pytest.mark.parametrize(
    "text",
    ['{"d_obs_m": 99}', '{"nonsense": 1}', '{"side": "left"}', '{"op_lost_ms": 60000}', "{}"],
)
def test_what_does_not_concern_safety_may_be_lost(tmp_path: Path, text: str) -> None:
    """A value that is less safe than the configuration is lost on purpose."""
    store = written(tmp_path, text)
    store.load(DEFAULTS, DEFAULTS)
    assert Desk(store).arm() == Reason.NONE


def test_stop_is_the_first_reason_not_to_arm(tmp_path: Path) -> None:
    store = written(tmp_path, "{")
    store.load(DEFAULTS, DEFAULTS)
    desk = Desk(store)
    desk.vehicle.receive(emergency_stop(7), 0)
    assert desk.arm() == Reason.EMERGENCY_STOPPED


def test_a_crash_while_saving_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(tmp_path)
    store.save("d_obs_m", 0.45)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    ticket = store.save("d_obs_m", 0.60)
    assert ticket is not None
    assert "No space" in str(ticket.error)
    params, _ = Store(tmp_path).load(DEFAULTS)
    assert params.d_obs_m == 0.45


def test_only_written_values_are_held(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert not store.holds("d_obs_m", 0.45)
    store.save("d_obs_m", 0.45)
    assert store.holds("d_obs_m", 0.45)
    assert not store.holds("d_obs_m", 0.5)
    again = Store(tmp_path)
    again.load(DEFAULTS)
    assert again.holds("d_obs_m", 0.45)


def test_without_a_directory_no_value_is_held() -> None:
    store = Store(None)
    store.save("d_obs_m", 0.45)
    assert not store.holds("d_obs_m", 0.45)


def test_value_that_could_not_be_written_is_not_held(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    store = Store(tmp_path / "file")
    ticket = store.save("d_obs_m", 0.45)
    assert ticket is not None
    assert "file" in str(ticket.error)
    assert not store.holds("d_obs_m", 0.45)
