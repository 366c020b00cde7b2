"""The person on an open bus: one for the programs of a user on a computer, without a file."""

import os
import pwd
import re
import socket
from pathlib import Path

import pytest

from protocol.bus import network
from protocol.bus.network import Network, Tls
from protocol.topic import MAX_PERSON, PERSON, operator_in, person_of
from protocol.wire.message import Message
from protocol.wire.messages import LeaseStatus
from runtime.errors import UserError
from tests.support.each import each

TLS = Tls(ca="ca.pem", certificate="ground.pem", key="ground.key")


@pytest.fixture(autouse=True)
def _unnamed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(network.VARIABLE, raising=False)


def test_programs_of_a_user_find_the_same_person() -> None:
    login = pwd.getpwuid(os.getuid()).pw_name
    found = network.person_here()
    assert found == network.person_here()
    assert re.fullmatch(rf"{re.escape(login)[:14]}-[0-9a-f]{{8}}", found)
    assert re.fullmatch(PERSON, found)


def test_users_computers_and_starts_are_told_apart(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = {network.person_here()}
    monkeypatch.setattr(os, "getuid", lambda: 4_000_000_000)
    found.add(network.person_here())
    monkeypatch.setattr(socket, "gethostname", lambda: "elsewhere")
    found.add(network.person_here())
    (tmp_path / "boot_id").write_text("another\n", encoding="ascii")
    monkeypatch.setattr(network, "BOOT_ID", tmp_path / "boot_id")
    found.add(network.person_here())
    monkeypatch.setattr(network, "BOOT_ID", tmp_path / "none")
    found.add(network.person_here())
    assert len(found) == 5
    assert all(re.fullmatch(PERSON, one) for one in found)
    assert len([one for one in found if one.startswith("user4000000000-")]) == 4


def test_a_login_that_no_key_may_contain_is_written_in_ascii() -> None:
    for login in ("jürgen/von*#?", "a" * 200, ""):
        found = network.with_digits(login)
        assert re.fullmatch(PERSON, found)
        assert len(found) <= MAX_PERSON
    assert network.with_digits("jürgen").startswith("j_rgen-")


def test_the_gateway_is_another_person_than_its_user(monkeypatch: pytest.MonkeyPatch) -> None:
    gateway = network.gateway_here()
    assert re.fullmatch(r"gateway-[0-9a-f]{8}", gateway)
    monkeypatch.setenv(network.VARIABLE, "ada")
    assert network.gateway_here() == gateway
    assert network.person_here() == "ada"


@each("name", ["", "a/b", "a b", "ä", "a" * 24, "ada\n", "*"])
def test_a_bad_name_is_refused_with_the_rule(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match="use 1 to 23 of the characters"):
        network.checked_person(name)
    if not name:
        return
    with pytest.raises(UserError, match="use 1 to 23 of the characters"):
        Network(person=name)
    monkeypatch.setenv(network.VARIABLE, name)
    with pytest.raises(UserError, match="SIDESTEP_PERSON"):
        network.person_here()


def test_with_a_certificate_no_person_is_configured() -> None:
    assert Network(person="ada").person == "ada"
    with pytest.raises(UserError, match="the certificate names the operator"):
        Network(person="ada", tls=TLS)


def test_the_longest_identity_fits_into_the_lease() -> None:
    identity = f"{'p' * MAX_PERSON}/{'f' * 32}"
    assert operator_in(identity) == identity
    assert person_of(identity) == "p" * MAX_PERSON
    status: Message = LeaseStatus(time_ns=1, lapses_ms=1, held=1, holder=identity, name="")
    assert status


def test_an_identity_that_names_nobody_has_no_person() -> None:
    assert person_of("") == ""
