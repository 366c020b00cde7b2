"""`keys check` reports the expiry of each certificate, and the faults of a bad one."""

import json
from datetime import timedelta
from pathlib import Path

import pytest

from ground.certificates.folder import check, make
from ground.cli.main import main
from runtime.errors import UserError
from tests.support.keyring import DAY, NOW, Keyring


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    make(tmp_path / "keys", ["r1"], {}, NOW - DAY, NOW + 100 * DAY)
    return tmp_path / "keys"


def wrong(folder: Path, name: str) -> str:
    (found,) = [one for one in check(folder, NOW) if one.file == f"{name}.pem"]
    return "; ".join(found.wrong)


def test_a_new_set_is_good(keys: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", "check", str(keys)]) == 0
    printed = capsys.readouterr().out
    for words in ("commands the robots", "only observes", "is the robot r1", "signs the others"):
        assert words in printed
    assert f"{NOW + 100 * DAY:%Y-%m-%d}" in printed


def test_with_json_each_has_its_end(keys: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", "check", str(keys), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["certificates"][0]["file"] == "ca.pem"
    assert all(
        one["until"].startswith(f"{NOW + 100 * DAY:%Y-%m-%d}") for one in found["certificates"]
    )


def test_what_ends_soon_is_a_warning(keys: Path) -> None:
    assert not any(one.soon for one in check(keys, NOW))
    assert all(one.soon and not one.wrong for one in check(keys, NOW + 80 * DAY))


def test_certificate_outside_its_validity_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ring = Keyring(tmp_path / "ring")
    ring.expired("ground")
    ring.early("viewer")
    assert main(["keys", "check", str(tmp_path / "ring")]) == 1
    printed = capsys.readouterr().out
    assert f"expired at {NOW - DAY:%Y-%m-%d}" in printed
    assert f"is not valid before {NOW + DAY:%Y-%m-%d}" in printed


def test_certificate_of_another_authority_is_reported(keys: Path, tmp_path: Path) -> None:
    other = Keyring(tmp_path / "other").tls("ground")
    (keys / "ground.pem").write_bytes(Path(other.certificate).read_bytes())
    (keys / "ground.key").write_bytes(Path(other.key).read_bytes())
    assert "is not signed by ca.pem" in wrong(keys, "ground")
    assert wrong(keys, "plant") == ""


def test_name_without_a_role_is_reported(tmp_path: Path) -> None:
    Keyring(tmp_path / "ring").tls("stranger")
    assert "there is no role 'stranger'" in wrong(tmp_path / "ring", "stranger")


def test_key_of_another_certificate_is_reported(keys: Path) -> None:
    (keys / "ground.key").write_bytes((keys / "viewer.key").read_bytes())
    assert "ground.key is the key of another certificate" in wrong(keys, "ground")


def test_invalid_key_is_reported_without_its_content(keys: Path) -> None:
    (keys / "ground.key").write_text("hunter2")
    assert "ground.key is not a PEM key" in wrong(keys, "ground")
    assert "hunter2" not in wrong(keys, "ground")


def test_missing_key_is_reported(keys: Path) -> None:
    (keys / "ground.key").unlink()
    assert "ground.key: No such file" in wrong(keys, "ground")


def test_key_readable_by_others_is_reported(keys: Path) -> None:
    (keys / "ground.key").chmod(0o644)
    assert "ground.key can be read by others: chmod 600 ground.key" in wrong(keys, "ground")


def test_what_is_no_certificate_is_named(keys: Path) -> None:
    (keys / "viewer.pem").write_text("nothing")
    with pytest.raises(UserError, match=r"viewer\.pem is not a certificate in PEM"):
        check(keys, NOW)


def test_a_folder_of_something_else_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["keys", "check", str(tmp_path)]) == 2
    assert f"{tmp_path} has no ca.pem" in capsys.readouterr().err


def test_the_moment_of_the_end_is_still_good(keys: Path) -> None:
    end = check(keys, NOW)[0].until
    assert not any(one.wrong for one in check(keys, end))
    assert all(one.wrong for one in check(keys, end + timedelta(seconds=1)))
