"""`up --locks DIR`: each process gets its own certificate, and the set must be complete."""

from pathlib import Path

import pytest

from ground.certificates.folder import make
from ground.launch.tls_configs import check, dialling, file_of, ground_file, locked, with_locks
from protocol.bus.network import Network
from runtime.errors import UserError
from tests.support.keyring import DAY, NOW

ROLES = ("router", "robot r1", "robot r2", "recorder r1", "plant")


@pytest.fixture
def keys(tmp_path: Path) -> str:
    make(tmp_path / "keys", ["r1", "r2"], {}, NOW - DAY, NOW + DAY)
    return str(tmp_path / "keys")


def test_each_role_has_its_certificate() -> None:
    assert [file_of("keys", role).name for role in ROLES] == [
        "router.toml",
        "robot-r1.toml",
        "robot-r2.toml",
        "ground.toml",
        "plant.toml",
    ]


def test_no_locks_changes_nothing() -> None:
    network = Network(mode="client", connect=("tcp/127.0.0.1:1",))
    assert with_locks(None, "plant", ["plant"]) == ["plant"]
    assert dialling(None, network) is network
    assert locked(None, "tcp/127.0.0.1:1") == "tcp/127.0.0.1:1"
    assert ground_file(None) is None
    check(None, ROLES)


def test_locks_add_the_configuration_file(keys: str) -> None:
    words = with_locks(keys, "robot r2", ["robot", "--id", "r2"])
    assert words == ["robot", "--id", "r2", "--config", f"{keys}/robot-r2.toml"]


def test_ground_dials_with_tls(keys: str) -> None:
    found = dialling(keys, Network(mode="client", connect=("tcp/127.0.0.1:1",)))
    assert found.connect == ("tls/127.0.0.1:1",)
    assert found.robots == ("r1", "r2")
    assert found.tls is not None
    assert found.tls.certificate == f"{keys}/ground.pem"


def test_check_names_a_missing_certificate(keys: str) -> None:
    check(keys, ROLES)
    with pytest.raises(UserError, match=r"there is no robot-r3\.toml for the robot r3: make a set"):
        check(keys, (*ROLES, "robot r3"))
