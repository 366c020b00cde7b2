"""Drop data that a slow reader does not accept, so that no other reader waits for it.

In Zenoh 1.10 a reply has the priority and the congestion control that its query came with: the
asker would choose that the answering process waits up to 5 s, and with it whatever else it sends to
that reader at the same priority. Each process therefore sets both on the queries that reach it.
Replies have priorities that no stream has, so a stream never waits behind one.
"""

from typing import Final

from protocol.topics import PARAMETERS, STOP_SERVICE, WORLD

ANSWERS: Final = "interactive_low"
LISTS: Final = "background"
"""Priority of long replies: JSON texts and cached events."""

STOPS: Final = "real_time"
WAIT_BEFORE_CLOSE_US: Final = 20_000
"""A reader that does not take what must not be dropped (declarations) is cut off after that."""

LISTS_BATCHES: Final = 16
"""Of 48 KiB, in the queue of lists for one reader: a whole history fits."""


def congestion(prefix: str) -> dict[str, object]:
    """Settings of a session. Of the rules that fit a query the last one holds."""
    lists = [f"{prefix}/*/{service.path}/**" for service in (PARAMETERS, WORLD)]
    return {
        "qos/network": [
            overwritten("answers", ["**"], ANSWERS),
            overwritten("stops", [f"{prefix}/*/{STOP_SERVICE.path}/**"], STOPS),
            overwritten("lists", [*lists, "**/@adv/**"], LISTS),
        ],
        "transport/link/tx/queue/size/background": LISTS_BATCHES,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": WAIT_BEFORE_CLOSE_US,
    }


def overwritten(name: str, keys: list[str], priority: str) -> dict[str, object]:
    """A rule for the queries that arrive on these keys, and so for the replies to them."""
    return {
        "id": name,
        "messages": ["query"],
        "flows": ["ingress"],
        "key_exprs": keys,
        "overwrite": {"priority": priority, "congestion_control": "drop"},
    }
