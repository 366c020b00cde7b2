"""Opens a Zenoh session the way this project wants it, and says in words why it could not.

Zenoh's own log is never initialised: it can only write to standard output, which belongs to
`--json` and to the terminal interface.
"""

import json
import re

import zenoh

from protocol.errors import BadEndpoint, EndpointInUse, NoPeer, UserError
from protocol.network import Network

RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
LEASE_MS = 1000
SOURCE_PLACES = re.compile(r" at /\S+")
BOUND_TO = re.compile(r"bound to (\S+?):? ")


def settings(network: Network) -> dict[str, object]:
    """Nobody is ever searched for: endpoints are explicit, and nothing waits to find more."""
    return {
        "mode": network.mode,
        "listen/endpoints": list(network.listen),
        "connect/endpoints": list(network.connect),
        "connect/timeout_ms": round(network.connect_timeout_s * 1000),
        "connect/retry": RETRY,  # nested keys that are null by default take only a whole object
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/keep_alive": 4,
        "transport/shared_memory/enabled": False,
        "adminspace/enabled": bool(network.listen),  # the only place that tells a bound port
    }


def open_session(network: Network) -> zenoh.Session:
    """Raises EndpointInUse, NoPeer or BadEndpoint, with the endpoint named."""
    config = zenoh.Config()
    try:
        for key, value in settings(network).items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise in_words(network, SOURCE_PLACES.sub("", str(error))) from error


def in_words(network: Network, text: str) -> UserError:
    """The error a person can act on."""
    found = BOUND_TO.search(text)
    here = found[1] if found else ", ".join(network.listen)
    there = ", ".join(network.connect)
    if "Address already in use" in text:
        return EndpointInUse(
            f"{here} is in use: stop the process that listens there, or choose another endpoint"
        )
    if "Unable to connect" in text:
        return NoPeer(
            f"nobody answers at {there} (waited {network.connect_timeout_s:g} s): "
            "start the process that listens there, or correct the endpoint"
        )
    if "listener" in text or "port value" in text:
        return BadEndpoint(f"cannot listen at {here}: {text}")
    return UserError(f"cannot open the bus: {text}")


def bound_endpoints(session: zenoh.Session) -> tuple[str, ...]:
    """Where a session really listens: the port behind a 0 is only known to its admin space."""
    for reply in session.get(f"@/{session.zid()}/*", timeout=1.0):
        if reply.ok is not None:
            found = json.loads(reply.ok.payload.to_bytes()).get("locators")
            if found:
                return tuple(found)
    return ()
