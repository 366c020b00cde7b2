"""`keys renew` gives a role a new certificate if the authority's key was kept."""

import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509

from ground.certificates.authority import hosts_in
from ground.certificates.folder import check, renew
from ground.cli.main import main
from protocol.bus.certificate import own_certificate
from protocol.bus.network import Tls
from runtime.errors import UserError
from tests.support.keyring import DAY, NOW


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    folder = tmp_path / "keys"
    words = ["--keep-authority", "100", "--days", "7", "--operators", "ada"]
    assert main(["keys", "new", str(folder), *words]) == 0
    return folder


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def days_of(path: Path) -> int:
    return round((certificate(path).not_valid_after_utc - NOW) / DAY)


def test_a_kept_authority_outlives_what_it_signs(keys: Path) -> None:
    assert (days_of(keys / "ca.pem"), days_of(keys / "router.pem")) == (100, 7)
    assert stat.S_IMODE((keys / "authority.key").stat().st_mode) == 0o600


def test_renewal_changes_the_key_and_keeps_the_host_names(keys: Path) -> None:
    before = {path.name: path.read_bytes() for path in keys.iterdir()}
    assert main(["keys", "renew", str(keys), "router", "ground-ada", "--days", "30"]) == 0
    after = {path.name: path.read_bytes() for path in keys.iterdir()}
    changed = {name for name in after if after[name] != before.get(name)}
    assert changed == {
        f"{role}.{end}" for role in ("router", "ground-ada") for end in ("pem", "key")
    }
    assert days_of(keys / "router.pem") == days_of(keys / "ground-ada.pem") == 30
    assert hosts_in(after["router.pem"]) == hosts_in(before["router.pem"])
    assert hosts_in(after["ground-ada.pem"]) == []
    assert stat.S_IMODE((keys / "router.key").stat().st_mode) == 0o600
    assert not any(one.wrong for one in check(keys, datetime.now(UTC)))
    tls = Tls(ca=f"{keys}/ca.pem", certificate=f"{keys}/router.pem", key=f"{keys}/router.key")
    assert own_certificate(tls).trouble == ""


def test_nothing_is_valid_longer_than_its_authority(keys: Path) -> None:
    until = renew(keys, ["viewer"], NOW - DAY, NOW + 1000 * DAY)
    assert timedelta() <= until - NOW <= 101 * DAY
    assert days_of(keys / "viewer.pem") == 100


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
    keys: Path, spoil: object, name: str, why: str
) -> None:
    assert callable(spoil)
    spoil(keys)
    before = {path.name: path.read_bytes() for path in keys.glob("*.pem")}
    with pytest.raises(UserError, match=why):
        renew(keys, ["router", name], NOW - DAY, NOW + DAY)
    assert {path.name: path.read_bytes() for path in keys.glob("*.pem")} == before
