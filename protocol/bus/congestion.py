"""Drop data that a slow reader does not accept, so that it delays no other reader.

In Zenoh 1.10 a reply has the priority and the congestion control of its query. A client could thus
make the answering process wait for up to 5 s, with everything else that it sends to that client at
the same priority. Each process therefore overwrites both on the queries that it receives. Replies
have priorities that no stream has, so a stream never waits behind a reply.
"""

from typing import Final

from protocol.topics import PARAMETERS, STOP_SERVICE, WORLD

ANSWERS: Final = "interactive_low"
LISTS: Final = "background"
"""Priority of long replies: JSON texts and cached events."""

STOPS: Final = "real_time"
WAIT_BEFORE_CLOSE_US: Final = 20_000
"""Time after which a reader that does not accept declarations is disconnected.

Declarations must not be dropped."""

LISTS_BATCHES: Final = 16
"""Batches of 48 KiB in the queue of long replies for one reader: a whole history fits."""


WAIT_BEFORE_DROP_US: Final = 1_000
PATIENT_WAIT_US: Final = 500_000
"""Time after which a sample that a reader does not accept is dropped. The longer one is less than
the time for which a plant in lockstep waits for its robot."""


def congestion(prefix: str, *, patient: bool = False) -> dict[str, object]:
    """Return the congestion settings of a session; the last matching rule applies."""
    lists = [f"{prefix}/*/{service.path}/**" for service in (PARAMETERS, WORLD)]
    return {
        "qos/network": [
            overwritten("answers", ["**"], ANSWERS),
            overwritten("stops", [f"{prefix}/*/{STOP_SERVICE.path}/**"], STOPS),
            overwritten("lists", [*lists, "**/@adv/**"], LISTS),
        ],
        "transport/link/tx/queue/size/background": LISTS_BATCHES,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": WAIT_BEFORE_CLOSE_US,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": (
            PATIENT_WAIT_US if patient else WAIT_BEFORE_DROP_US
        ),
    }


def overwritten(name: str, keys: list[str], priority: str) -> dict[str, object]:
    """Return a rule for the queries that arrive on these keys, and so for the replies to them."""
    return {
        "id": name,
        "messages": ["query"],
        "flows": ["ingress"],
        "key_exprs": keys,
        "overwrite": {"priority": priority, "congestion_control": "drop"},
    }
