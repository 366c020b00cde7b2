"""Network settings: an endpoint that cannot work is refused before anything is opened."""

import pytest

from protocol.errors import BadEndpoint
from protocol.network import Network


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/[::]:0",
        "tls/robot.local:7447#root_ca_certificate=ca.pem",
        "udp/10.0.0.1:7447",
        "unixsock-stream//run/sidestep.sock",
    ],
)
def test_good_endpoints_are_taken(endpoint: str) -> None:
    assert Network(mode="peer", listen=(endpoint,), connect=(endpoint,)).listen == (endpoint,)


@pytest.mark.parametrize(
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
        "unixsock-stream/",
    ],
)
def test_a_bad_endpoint_is_named(endpoint: str) -> None:
    with pytest.raises(BadEndpoint) as caught:
        Network(mode="peer", listen=(endpoint,))
    assert repr(endpoint) in str(caught.value)
    assert "tcp/127.0.0.1:7447" in str(caught.value)


def test_a_client_has_to_be_told_where_to_connect() -> None:
    with pytest.raises(BadEndpoint, match="client needs an endpoint"):
        Network(mode="client")


def test_a_router_has_to_be_told_where_to_listen() -> None:
    with pytest.raises(BadEndpoint, match="router needs an endpoint"):
        Network(mode="router")


@pytest.mark.parametrize("prefix", ["", "a*", "/a", "a/", "a//b", "a?b"])
def test_a_prefix_that_is_no_plain_key_is_refused(prefix: str) -> None:
    with pytest.raises(BadEndpoint, match="prefix"):
        Network(prefix=prefix)
