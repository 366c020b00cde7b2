"""Zenoh's settings for mutual TLS and access control."""

from protocol.bus.network import Network
from protocol.bus.tls.certificate import own_certificate
from protocol.bus.tls.certificate_advice import remedy
from protocol.bus.tls.rules import access_control, dialled_access_control
from runtime.errors import KeysError


def tls_settings(network: Network) -> dict[str, object]:
    """Return the TLS and access-control settings of a session; empty without TLS.

    Raises KeysError for unusable files, and for a listener whose certificate others would reject.
    """
    tls = network.tls
    if tls is None:
        return {}
    seen = own_certificate(tls)
    if network.listen and seen.trouble:
        raise KeysError(f"{seen.trouble}, so all others would reject it: {remedy(seen)}")
    found: dict[str, object] = {
        "transport/link/protocols": ["tls"],
        "transport/link/tls/root_ca_certificate": tls.ca,
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/listen_certificate": tls.certificate,
        "transport/link/tls/listen_private_key": tls.key,
        "transport/link/tls/connect_certificate": tls.certificate,
        "transport/link/tls/connect_private_key": tls.key,
        "transport/link/tls/close_link_on_expiration": True,
    }
    if network.listen:
        found["access_control"] = access_control(network)
    elif allowed := dialled_access_control(network, seen.name):
        found["access_control"] = allowed
    return found
