"""`keys new`, `keys check` and `keys renew`: certificates made, judged, kept valid."""

import json
import os
import stat
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from ground import certificates as folder_module
from ground.certificates import Pair, check, hosts_in, make, renew
from ground.cli.main import main, parse
from ground.cli.options import common_of
from protocol.bus.certificate import own_certificate
from protocol.bus.network import Tls
from protocol.stop_datagram import load_secrets
from runtime.errors import UserError
from tests.support.each import each
from tests.support.networks import DAY, NOW, Keyring

NAMES = ("router", "plant", "ground", "viewer", "recorder", "gateway", "robot-r1", "robot-r2")
STOPPED_BY_DATAGRAM = ("ground", "gateway", "robot-r1", "robot-r2")


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    folder = tmp_path / "keys"
    words = [
        "keys",
        "new",
        str(folder),
        "--robots",
        "r1",
        "r2",
        "--host",
        "rover.local",
        "10.0.0.5",
        "r2=10.0.0.2",
    ]
    assert main(words) == 0
    return folder


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_each_role_gets_certificate_key_and_configuration(keys: Path) -> None:
    ends = (".pem", ".key", ".toml")
    assert {path.name for path in keys.iterdir()} == {
        "ca.pem",
        *(name + end for name in NAMES for end in ends),
        *(f"{name}.stops" for name in STOPPED_BY_DATAGRAM),
    }


def secrets_in(folder: Path) -> dict[str, dict[str, bytes]]:
    """Return the stop secrets of each role, by the name of the other side."""
    return {
        path.stem: dict(load_secrets(Tls(ca="a", certificate="b", key=str(path))).by_name)
        for path in folder.glob("*.stops")
    }


def test_each_operator_shares_a_secret_of_its_own_with_each_robot(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    assert main(["keys", "new", str(keys), "--robots", "r1", "r2", "--operators", "ada"]) == 0
    found = secrets_in(keys)
    operators = {"ground": "ground", "gateway": "gateway", "ada": "ground-ada"}
    assert found.keys() == {"robot-r1", "robot-r2", *operators.values()}
    pairs = [
        (found[f"robot-{robot}"][name], found[role][robot])
        for name, role in operators.items()
        for robot in ("r1", "r2")
    ]
    assert all(ours == theirs for ours, theirs in pairs)
    assert len({ours for ours, _ in pairs}) == len(pairs) == 6
    assert {stat.S_IMODE(path.stat().st_mode) for path in keys.glob("*.stops")} == {0o600}


def test_secrets_are_added_to_an_older_folder_once(
    keys: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = secrets_in(keys)
    for path in keys.glob("*.stops"):
        path.unlink()
    assert main(["keys", "stops", str(keys)]) == 0
    assert "copy each .stops file" in capsys.readouterr().out
    after = secrets_in(keys)
    assert {role: of.keys() for role, of in after.items()} == {
        role: of.keys() for role, of in before.items()
    }
    assert after["ground"] != before["ground"]
    assert main(["keys", "stops", str(keys)]) == 2
    assert "has stop secrets already" in capsys.readouterr().err
    assert secrets_in(keys) == after


def test_a_folder_of_something_else_gets_no_secrets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["keys", "stops", str(tmp_path)]) == 2
    assert "name a folder of `keys new`" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_each_operator_gets_a_certificate_of_its_own(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    assert main(["keys", "new", str(keys), "--operators", "ada,bob", "eve"]) == 0
    for name in ("ground-ada", "ground-bob", "ground-eve"):
        common = common_of(parse(["hold", "--config", str(keys / f"{name}.toml")]))
        assert common.network.tls is not None
        assert own_certificate(common.network.tls).name == name
        assert common.network.operators == ("ada", "bob", "eve")
    assert main(["keys", "check", str(keys)]) == 0


@pytest.mark.parametrize(
    ("names", "why"),
    [("open", "every operator on an open bus"), ("ada,ada", "a name of its own"), ("A", "use 1")],
)
def test_invalid_operators_are_refused_before_writing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], names: str, why: str
) -> None:
    assert main(["keys", "new", str(tmp_path / "keys"), "--operators", names]) == 2
    assert why in capsys.readouterr().err
    assert not (tmp_path / "keys").exists()


def test_certificate_is_revoked_in_every_configuration(keys: Path) -> None:
    assert main(["keys", "revoke", str(keys), "robot-r2"]) == 0
    assert main(["keys", "revoke", str(keys), "viewer", "robot-r2"]) == 0
    for name in NAMES:
        common = common_of(parse(["hold", "--id", "r1", "--config", str(keys / f"{name}.toml")]))
        assert common.network.revoked == ("robot-r2", "viewer")


def test_what_has_no_certificate_cannot_be_revoked(
    keys: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["keys", "revoke", str(keys), "robot-r9"]) == 2
    assert "has no certificate robot-r9.pem" in capsys.readouterr().err
    (keys / "ground.toml").write_text("[network]\n")
    assert main(["keys", "revoke", str(keys), "robot-r2"]) == 2
    assert "ground.toml: the line `revoked = []` is missing" in capsys.readouterr().err


def test_only_the_owner_can_read_a_key(keys: Path) -> None:
    assert stat.S_IMODE(keys.stat().st_mode) == 0o700
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in keys.glob("*.key")}
    assert set(modes.values()) == {0o600}


def test_the_mask_of_the_shell_opens_nothing(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        assert main(["keys", "new", str(tmp_path / "open")]) == 0
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "open").stat().st_mode) == 0o700
    assert stat.S_IMODE((tmp_path / "open" / "ground.key").stat().st_mode) == 0o600


def test_the_key_of_the_authority_is_not_kept(keys: Path) -> None:
    authority = certificate(keys / "ca.pem").public_key()
    assert not (keys / "ca.key").exists()
    for name in NAMES:
        assert certificate(keys / f"{name}.pem").public_key() != authority


@each("name", NAMES)
def test_each_certificate_is_trusted_and_names_its_holder(keys: Path, name: str) -> None:
    tls = Tls(ca=f"{keys}/ca.pem", certificate=f"{keys}/{name}.pem", key=f"{keys}/{name}.key")
    seen = own_certificate(tls)
    assert (seen.name, seen.trouble) == (name, "")


@pytest.mark.parametrize(
    ("name", "hosts"),
    [
        ("router", {"router", "rover.local", "10.0.0.5"}),
        ("robot-r1", {"robot-r1"}),
        ("robot-r2", {"robot-r2", "10.0.0.2"}),
    ],
)
def test_no_robot_has_the_names_of_the_router_or_of_another(
    keys: Path, name: str, hosts: set[str]
) -> None:
    assert names_in(keys / f"{name}.pem") == {"localhost", "127.0.0.1", "::1", *hosts}


def names_in(path: Path) -> set[str]:
    """Return the host names of a certificate."""
    names = certificate(path).extensions.get_extension_for_class(x509.SubjectAlternativeName)
    addresses = {str(one) for one in names.value.get_values_for_type(x509.IPAddress)}
    return addresses | set(names.value.get_values_for_type(x509.DNSName))


def test_a_host_is_that_of_the_only_robot_too(tmp_path: Path) -> None:
    assert main(["keys", "new", str(tmp_path / "keys"), "--host", "rover.local"]) == 0
    for name in ("router", "robot-r1"):
        assert "rover.local" in names_in(tmp_path / "keys" / f"{name}.pem")


def test_a_host_of_a_robot_that_there_is_not_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["keys", "new", str(tmp_path / "keys"), "--host", "r9=10.0.0.9"]) == 2
    assert "--robots has no r9" in capsys.readouterr().err


def test_client_certificate_is_no_server_certificate(keys: Path) -> None:
    for name in ("plant", "ground", "viewer", "recorder", "gateway"):
        extensions = certificate(keys / f"{name}.pem").extensions
        usage = extensions.get_extension_for_class(x509.ExtendedKeyUsage)
        assert list(usage.value) == [ExtendedKeyUsageOID.CLIENT_AUTH]
        with pytest.raises(x509.ExtensionNotFound):
            extensions.get_extension_for_class(x509.SubjectAlternativeName)


def test_a_configuration_serves_its_process_as_it_is(keys: Path) -> None:
    common = common_of(parse(["hold", "--config", str(keys / "ground.toml")]))
    assert common.robot == "r1"
    assert common.endpoint == "tls/127.0.0.1:7447"
    assert common.network.robots == ("r1", "r2")
    assert common.network.tls is not None
    assert common.network.tls.key == f"{keys}/ground.key"


def test_the_folder_can_be_moved(keys: Path) -> None:
    moved = keys.rename(keys.with_name("moved"))
    common = common_of(parse(["hold", "--config", str(moved / "ground.toml")]))
    assert common.network.tls is not None
    assert own_certificate(common.network.tls).name == "ground"


def test_nothing_is_overwritten(keys: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name: path.read_bytes() for path in keys.iterdir()}
    assert main(["keys", "new", str(keys)]) == 2
    assert "is not empty (it has ca.pem), and no file is overwritten" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in keys.iterdir()} == before


def test_an_empty_folder_is_taken_and_closed_to_others(tmp_path: Path) -> None:
    folder = tmp_path / "mounted"
    folder.mkdir(mode=0o755)
    assert main(["keys", "new", str(folder)]) == 0
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_half_a_set_is_not_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    put = folder_module.create_file

    def full(path: Path, content: bytes, mode: int, written: list[Path]) -> None:
        put(path, content, mode, written)
        if path.name == "ground.key":
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(folder_module, "create_file", full)
    assert main(["keys", "new", str(tmp_path / "keys")]) == 2
    assert "No space left on device: all new files were removed" in capsys.readouterr().err
    assert list((tmp_path / "keys").iterdir()) == []


@each(
    ("words", "message"),
    [
        (("--robots", "R 1"), "robot name 'R 1'"),
        (("--robots", "r1", "r1"), "each robot needs a name of its own"),
        (("--host", "a b"), "'a b' is neither a host name nor an address"),
        (("--host", "rover-"), "'rover-'"),
        (("--days", "0"), "0 is not within 1 to 3650"),
        (("--days", "many"), "'many' is not a whole number"),
    ],
)
def test_what_cannot_be_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    assert main(["keys", "new", str(tmp_path / "keys"), *words]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "keys").exists()


def test_a_place_that_is_no_folder_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    assert main(["keys", "new", str(file)]) == 2
    assert f"{file}: File exists: name a folder that can be created" in capsys.readouterr().err


def test_missing_library_names_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "cryptography", None)
    assert main(["keys", "new", str(tmp_path / "keys")]) == 2
    assert "pip install 'sidestep[keys]'" in capsys.readouterr().err


def test_a_secret_does_not_show_in_a_message() -> None:
    assert "secret" not in repr(Pair(b"open", b"secret"))


def test_json_lists_the_roles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", "new", str(tmp_path / "keys"), "--days", "7", "--json"]) == 0
    printed = capsys.readouterr().out
    assert (
        '"roles": ["router", "plant", "ground", "viewer", "recorder", "gateway", "robot-r1"]'
        in printed
    )
    assert "PRIVATE" not in printed


@pytest.fixture
def keys_of_yesterday(tmp_path: Path) -> Path:
    make(tmp_path / "keys", ["r1"], {}, NOW - DAY, NOW + 100 * DAY)
    return tmp_path / "keys"


def wrong(folder: Path, name: str) -> str:
    (found,) = [one for one in check(folder, NOW) if one.file == f"{name}.pem"]
    return "; ".join(found.wrong)


def test_a_new_set_is_good(keys_of_yesterday: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", "check", str(keys_of_yesterday)]) == 0
    printed = capsys.readouterr().out
    for words in ("commands the robots", "only observes", "is the robot r1", "signs the others"):
        assert words in printed
    assert f"{NOW + 100 * DAY:%Y-%m-%d}" in printed


def test_with_json_each_has_its_end(
    keys_of_yesterday: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["keys", "check", str(keys_of_yesterday), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["certificates"][0]["file"] == "ca.pem"
    assert all(
        one["until"].startswith(f"{NOW + 100 * DAY:%Y-%m-%d}") for one in found["certificates"]
    )


def test_what_ends_soon_is_a_warning(keys_of_yesterday: Path) -> None:
    assert not any(one.soon for one in check(keys_of_yesterday, NOW))
    assert all(one.soon and not one.wrong for one in check(keys_of_yesterday, NOW + 80 * DAY))


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


def test_certificate_of_another_authority_is_reported(
    keys_of_yesterday: Path, tmp_path: Path
) -> None:
    other = Keyring(tmp_path / "other").tls("ground")
    (keys_of_yesterday / "ground.pem").write_bytes(Path(other.certificate).read_bytes())
    (keys_of_yesterday / "ground.key").write_bytes(Path(other.key).read_bytes())
    assert "is not signed by ca.pem" in wrong(keys_of_yesterday, "ground")
    assert wrong(keys_of_yesterday, "plant") == ""


def test_name_without_a_role_is_reported(tmp_path: Path) -> None:
    Keyring(tmp_path / "ring").tls("stranger")
    assert "there is no role 'stranger'" in wrong(tmp_path / "ring", "stranger")


def test_key_of_another_certificate_is_reported(keys_of_yesterday: Path) -> None:
    (keys_of_yesterday / "ground.key").write_bytes((keys_of_yesterday / "viewer.key").read_bytes())
    assert "ground.key is the key of another certificate" in wrong(keys_of_yesterday, "ground")


def test_invalid_key_is_reported_without_its_content(keys_of_yesterday: Path) -> None:
    (keys_of_yesterday / "ground.key").write_text("hunter2")
    assert "ground.key is not a PEM key" in wrong(keys_of_yesterday, "ground")
    assert "hunter2" not in wrong(keys_of_yesterday, "ground")


def test_missing_key_is_reported(keys_of_yesterday: Path) -> None:
    (keys_of_yesterday / "ground.key").unlink()
    assert "ground.key: No such file" in wrong(keys_of_yesterday, "ground")


def test_key_readable_by_others_is_reported(keys_of_yesterday: Path) -> None:
    (keys_of_yesterday / "ground.key").chmod(0o644)
    assert "ground.key can be read by others: chmod 600 ground.key" in wrong(
        keys_of_yesterday, "ground"
    )


def test_what_is_no_certificate_is_named(keys_of_yesterday: Path) -> None:
    (keys_of_yesterday / "viewer.pem").write_text("nothing")
    with pytest.raises(UserError, match=r"viewer\.pem is not a certificate in PEM"):
        check(keys_of_yesterday, NOW)


def test_a_folder_of_something_else_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["keys", "check", str(tmp_path)]) == 2
    assert f"{tmp_path} has no ca.pem" in capsys.readouterr().err


def test_the_moment_of_the_end_is_still_good(keys_of_yesterday: Path) -> None:
    end = check(keys_of_yesterday, NOW)[0].until
    assert not any(one.wrong for one in check(keys_of_yesterday, end))
    assert all(one.wrong for one in check(keys_of_yesterday, end + timedelta(seconds=1)))


@pytest.fixture
def keys_with_kept_authority(tmp_path: Path) -> Path:
    folder = tmp_path / "keys"
    words = ["--keep-authority", "100", "--days", "7", "--operators", "ada"]
    assert main(["keys", "new", str(folder), *words]) == 0
    return folder


def days_of(path: Path) -> int:
    return round((certificate(path).not_valid_after_utc - NOW) / DAY)


def test_a_kept_authority_outlives_what_it_signs(keys_with_kept_authority: Path) -> None:
    assert (
        days_of(keys_with_kept_authority / "ca.pem"),
        days_of(keys_with_kept_authority / "router.pem"),
    ) == (100, 7)
    assert stat.S_IMODE((keys_with_kept_authority / "authority.key").stat().st_mode) == 0o600


def test_renewal_changes_the_key_and_keeps_the_host_names(keys_with_kept_authority: Path) -> None:
    before = {path.name: path.read_bytes() for path in keys_with_kept_authority.iterdir()}
    assert (
        main(
            ["keys", "renew", str(keys_with_kept_authority), "router", "ground-ada", "--days", "30"]
        )
        == 0
    )
    after = {path.name: path.read_bytes() for path in keys_with_kept_authority.iterdir()}
    changed = {name for name in after if after[name] != before.get(name)}
    assert changed == {
        f"{role}.{end}" for role in ("router", "ground-ada") for end in ("pem", "key")
    }
    assert (
        days_of(keys_with_kept_authority / "router.pem")
        == days_of(keys_with_kept_authority / "ground-ada.pem")
        == 30
    )
    assert hosts_in(after["router.pem"]) == hosts_in(before["router.pem"])
    assert hosts_in(after["ground-ada.pem"]) == []
    assert stat.S_IMODE((keys_with_kept_authority / "router.key").stat().st_mode) == 0o600
    assert not any(one.wrong for one in check(keys_with_kept_authority, datetime.now(UTC)))
    tls = Tls(
        ca=f"{keys_with_kept_authority}/ca.pem",
        certificate=f"{keys_with_kept_authority}/router.pem",
        key=f"{keys_with_kept_authority}/router.key",
    )
    assert own_certificate(tls).trouble == ""


def test_nothing_is_valid_longer_than_its_authority(keys_with_kept_authority: Path) -> None:
    until = renew(keys_with_kept_authority, ["viewer"], NOW - DAY, NOW + 1000 * DAY)
    assert timedelta() <= until - NOW <= 101 * DAY
    assert days_of(keys_with_kept_authority / "viewer.pem") == 100


@pytest.mark.parametrize(
    ("spoil", "name", "why"),
    [
        (lambda keys: (keys / "authority.key").unlink(), "viewer", "keys new --keep-authority"),
        (
            lambda keys: (keys / "authority.key").write_bytes((keys / "viewer.key").read_bytes()),
            "viewer",
            "does not belong to the authority",
        ),
        (lambda keys: (keys / "authority.key").write_text("x"), "viewer", "authority.key"),
        (lambda keys: None, "nobody", "has no certificate nobody.pem"),
        (lambda keys: None, "ca", "has no certificate ca.pem"),
    ],
)
def test_what_cannot_be_renewed_is_named_and_left_as_it_is(
    keys_with_kept_authority: Path, spoil: object, name: str, why: str
) -> None:
    assert callable(spoil)
    spoil(keys_with_kept_authority)
    before = {path.name: path.read_bytes() for path in keys_with_kept_authority.glob("*.pem")}
    with pytest.raises(UserError, match=why):
        renew(keys_with_kept_authority, ["router", name], NOW - DAY, NOW + DAY)
    assert {
        path.name: path.read_bytes() for path in keys_with_kept_authority.glob("*.pem")
    } == before
