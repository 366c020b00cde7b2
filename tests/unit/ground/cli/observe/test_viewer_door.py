"""The door of the bridge admits Foxglove and pages of this computer, and no other page."""

from ipaddress import ip_address

from gateways.foxglove_bridge import answer, hidden_address, is_admitted, refusal_of
from tests.support.each import each

OTHER = "https://viewer.example"


@each(
    "origin",
    [
        "https://app.foxglove.dev",
        "https://studio.foxglove.dev",
        "file://",
        "http://localhost:8080",
        "https://localhost",
        "http://127.0.0.1:3000",
        "http://[::1]:8080",
        OTHER,
    ],
)
def test_origin_that_is_admitted(origin: str) -> None:
    assert is_admitted(origin, [OTHER])
    assert refusal_of(head(("Origin", origin)), [OTHER]) is None


@each(
    "origin",
    [
        "http://evil.example",
        "null",
        "",
        "http://app.foxglove.dev",
        "https://app.foxglove.dev.evil.example",
        "https://app.foxglove.dev:444",
        "http://localhost.evil.example",
        "http://localhost@evil.example",
        "http://evil@localhost",
        "http://127.0.0.1.evil.example",
        "http://192.168.1.4:8080",
        "ftp://localhost",
        "localhost",
        "http://[::1",
        "http://localhost/page",
        "file:///page.html",
        "https://viewer.example:444",
    ],
)
def test_origin_that_is_refused(origin: str) -> None:
    assert not is_admitted(origin, [OTHER])
    assert refusal_of(head(("oRIGIN", origin)), [OTHER]) is not None


def head(*fields: tuple[str, str], upgrade: str = "WebSocket") -> bytes:
    lines = ["GET / HTTP/1.1", *(f"{name}: {value}" for name, value in fields)]
    return "\r\n".join([*lines, f"Upgrade: {upgrade}", "", ""]).encode()


def test_client_without_an_origin_is_no_page() -> None:
    assert refusal_of(head(), []) is None


def test_second_origin_does_not_hide_the_first() -> None:
    fields = ("Origin", "http://localhost"), ("Origin", "http://evil.example")
    for two in (fields, fields[::-1]):
        found = refusal_of(head(*two), [])
        assert found is not None
        assert found[0] == "403 Forbidden"


def test_refusal_names_the_option_and_prints_no_control_character() -> None:
    found = refusal_of(head(("Origin", "http://evil.example\x1b[2J")), [])
    assert found is not None
    status, text = found
    assert "--origin http://evil.example[2J" in text
    assert answer(status, text).endswith(b"\r\n\r\n" + text.encode())


def test_only_web_sockets_are_admitted() -> None:
    for upgrade in ("h2c", "websocket, h2c"):
        found = refusal_of(head(upgrade=upgrade), [])
        assert found is not None
        assert found[0] == "426 Upgrade Required"


def test_hidden_address_is_on_this_computer() -> None:
    found = {hidden_address() for _ in range(100)}
    assert all(ip_address(one).is_loopback for one in found)
    assert len(found) > 90
    assert not any(one.startswith("127.0.") for one in found)
