import traceback
from collections.abc import Callable
from pathlib import Path

import pytest

from ground.user.mavlink_keys import (
    KeyRing,
    SigningKey,
    new_key,
    read_keys,
    usual_file,
    write_keys,
)
from runtime.errors import ConfigError, UserError


def test_keys_are_written_for_the_owner_only(tmp_path: Path) -> None:
    path, ring = tmp_path / "config" / "keys.toml", KeyRing(key=(new_key(), new_key()))
    write_keys(path, ring)
    assert path.stat().st_mode & 0o777 == 0o600
    assert read_keys(path) == ring
    assert read_keys(tmp_path / "none.toml") == KeyRing()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660])
def test_keys_that_others_may_read_are_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "keys.toml"
    write_keys(path, KeyRing(key=(new_key(),)))
    path.chmod(mode)
    with pytest.raises(UserError, match="chmod 600"):
        read_keys(path)


def test_text_of_a_key_has_no_secret() -> None:
    key = new_key()
    for text in (repr(key), str(key), f"{KeyRing(key=(key,))}", key.name):
        assert key.secret not in text
        assert key.passphrase not in text


def test_key_is_the_hash_of_its_passphrase() -> None:
    """As MAVProxy, Mission Planner and QGroundControl make it, as read in the source."""
    from hashlib import sha256

    key = new_key()
    assert key.raw == sha256(key.passphrase.encode()).digest()
    assert key != new_key()


@pytest.mark.parametrize("text", ["[[key]]\nsecret = 'abc'\n", "[[key]]\nsecrt = ''\n"])
def test_damaged_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "keys.toml"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(ConfigError):
        read_keys(path)


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text.replace('"\n', "\n", 1),
        lambda text: text.replace("secret = ", "secrt = ", 1),
        lambda text: text.replace("secret", "secret = secret", 1),
        lambda text: text.replace("[[key]]", "[[key]", 1),
        lambda text: text.replace('secret = "', 'secret = "X', 1),
        lambda text: text + text.replace("[[key]]", "[key]"),
        lambda text: text * 3,
    ],
)
def test_error_about_a_damaged_file_has_no_secret(
    tmp_path: Path, damage: Callable[[str], str]
) -> None:
    """Nor has its traceback: it goes to a terminal, and to the log of `up`."""
    path, key = tmp_path / "keys.toml", new_key()
    write_keys(path, KeyRing(key=(key,)))
    path.write_text(damage(path.read_text()))
    with pytest.raises(UserError) as caught:
        read_keys(path)
    text = "".join(traceback.format_exception(caught.value))
    assert key.secret not in text
    assert key.passphrase not in text


def test_usual_file_is_in_the_folder_of_the_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", "/somewhere")
    assert usual_file() == Path("/somewhere/sidestep/mavlink-keys.toml")
    assert SigningKey(secret="0" * 64).raw == bytes(32)


def test_folder_is_no_file_of_keys(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is not a file"):
        read_keys(tmp_path)
