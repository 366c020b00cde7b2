from pathlib import Path

import pytest

from robot.core.parameters import DEFAULTS
from robot.storage.files import FILE_NAME, Store


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
