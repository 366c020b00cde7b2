"""Network settings: an impossible endpoint is rejected before a session opens."""

import pytest

from protocol.bus.network import Network, Tls
from runtime.errors import EndpointError, UserError
from tests.support.each import each

TLS = Tls(ca="ca.pem", certificate="ground.pem", key="ground.key")


@each(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/[::]:0",
        "udp/10.0.0.1:7447",
        "unixsock-stream//run/sidestep.sock",
    ],
)
def test_good_endpoints_are_taken(endpoint: str) -> None:
    assert Network(mode="peer", listen=(endpoint,), connect=(endpoint,)).listen == (endpoint,)


@each(
    "endpoint",
    [
        "",
        "banana",
        "127.0.0.1:7447",
        "tcp/",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:",
        "tcp/:7447",
        "tcp/127.0.0.1:99999",
        "tcp/127.0.0.1:80x",
        "foo/127.0.0.1:7447",
        "ws/127.0.0.1:7447",
        "unixsock-stream/",
    ],
)
def test_a_bad_endpoint_is_named(endpoint: str) -> None:
    with pytest.raises(EndpointError) as caught:
        Network(mode="peer", listen=(endpoint,))
    assert repr(endpoint) in str(caught.value)
    assert "tcp/127.0.0.1:7447" in str(caught.value)


def test_client_needs_a_connect_endpoint() -> None:
    with pytest.raises(EndpointError, match="client needs an endpoint"):
        Network(mode="client")


def test_router_needs_a_listen_endpoint() -> None:
    with pytest.raises(EndpointError, match="router needs an endpoint"):
        Network(mode="router")


@each("prefix", ["", "a*", "/a", "a/", "a//b", "a?b"])
def test_prefix_that_is_no_plain_key_is_rejected(prefix: str) -> None:
    with pytest.raises(EndpointError, match="prefix"):
        Network(prefix=prefix)


def test_configured_keys_apply_tls_to_all_links() -> None:
    network = Network(listen=("tls/[::]:7447",), connect=("tls/robot.local:7447",), tls=TLS)
    assert network.tls is TLS


@each("endpoint", ["tcp/127.0.0.1:7447", "udp/127.0.0.1:1", "unixsock-stream/x"])
@each("where", ["listen", "connect"])
def test_plain_endpoint_among_tls_endpoints_is_rejected(where: str, endpoint: str) -> None:
    with pytest.raises(EndpointError, match="has no TLS") as caught:
        Network(tls=TLS, **{where: ("tls/127.0.0.1:1", endpoint)})  # type: ignore[arg-type]
    assert repr(endpoint) in str(caught.value)


def test_certificate_without_its_key_is_rejected() -> None:
    with pytest.raises(EndpointError, match=r"'tls/robot:7447' needs \[network\.tls\].*keys new"):
        Network(connect=("tls/robot:7447",))


def test_endpoint_option_cannot_disable_tls() -> None:
    with pytest.raises(EndpointError, match="remove the part from '#' on"):
        Network(listen=("tls/127.0.0.1:7447#enable_mtls=false",), tls=TLS)


def test_empty_tls_file_name_is_rejected() -> None:
    with pytest.raises(UserError, match="key is empty"):
        Tls(ca="ca.pem", certificate="ground.pem", key="")


def test_listener_tracks_twenty_robots_by_default() -> None:
    assert (Network().robots[0], Network().robots[-1], len(Network().robots)) == ("r1", "r20", 20)
    assert Network(robots=("kitchen",)).robots == ("kitchen",)
    with pytest.raises(UserError, match="robot name 'R 1'"):
        Network(robots=("r1", "R 1"))
