"""Test the reading of addresses and tokens."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.web import Address, address_of, token_of
from runtime.errors import UserError
from tests.support.each import each


@each(
    ("text", "found"),
    [
        ("", Address("127.0.0.1", 8770)),
        ("9000", Address("127.0.0.1", 9000)),
        (":9000", Address("127.0.0.1", 9000)),
        ("0.0.0.0", Address("0.0.0.0", 8770)),
        ("0.0.0.0:80", Address("0.0.0.0", 80)),
        ("ground.local:9000", Address("ground.local", 9000)),
        ("[::1]:9000", Address("::1", 9000)),
    ],
)
def test_address_is_completed_with_defaults(text: str, found: Address) -> None:
    assert address_of(text) == found


@each("text", ["127.0.0.1:0", "1:99999", "0", "a b:80", "http://x:80", "x:/80"])
def test_malformed_address_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="--web"):
        address_of(text)


@given(st.text(max_size=40))
def test_any_text_is_an_address_or_refused(text: str) -> None:
    try:
        found = address_of(text)
    except UserError:
        return
    assert found.host
    assert 0 < found.port < 65536


def test_url_carries_the_token() -> None:
    assert Address("127.0.0.1", 80).url("abc") == "http://127.0.0.1:80/?token=abc"
    assert Address("::1", 80).url("abc") == "http://[::1]:80/?token=abc"


def test_only_loopback_is_local() -> None:
    assert Address("127.0.0.1", 1).local
    assert Address("localhost", 1).local
    assert not Address("0.0.0.0", 1).local


def test_each_start_has_a_new_token() -> None:
    tokens = {token_of(None) for _ in range(20)}
    assert len(tokens) == 20
    assert min(map(len, tokens)) >= 24


def test_token_is_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text("0123456789abcdef-_\n")
    assert token_of(str(file)) == "0123456789abcdef-_"


@pytest.mark.parametrize(
    "content", [b"", b"short", b"0123456789abcde;", "0123456789abcdef\u00e4".encode()]
)
def test_short_or_untypable_token_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "token"
    file.write_bytes(content)
    with pytest.raises(UserError, match="--token-file"):
        token_of(str(file))


def test_missing_token_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nowhere: No such file"):
        token_of(str(tmp_path / "nowhere"))
