"""Events outlive a cut: who tells them keeps the newest, who listens fetches what it has missed.

By Zenoh's advanced publishers and subscribers, on the keys `KEY/@adv/...` beside each such key.
What was fetched is known from what has just been told, and says when it was told.
"""

import time
from typing import Any, Final

import zenoh
from zenoh import ext
from zenoh.handlers import Callback

BEAT_S: Final = 0.5
"""So often its sender tells how many events there were; the last before a silence is missed no
later than that."""

TOLD: Final = zenoh.CongestionControl.DROP
FETCHED: Final = zenoh.CongestionControl.BLOCK
"""What tells the two apart on arrival; only an answer may wait, for it is asked for."""


def keeping(
    session: zenoh.Session, key: str, newest: int, **service: Any
) -> "ext.AdvancedPublisher":
    """A publisher that keeps so many of its newest samples for whoever asks for them."""
    return ext.declare_advanced_publisher(
        session,
        key,
        congestion_control=TOLD,
        cache=ext.CacheConfig(
            newest, replies_config=ext.RepliesConfig(congestion_control=FETCHED, express=False)
        ),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=BEAT_S, sporadic_heartbeat=None),
        publisher_detection=True,
        **service,
    )


def following(
    session: zenoh.Session, key: str, newest: int, callback: "Callback[zenoh.Sample]"
) -> Any:
    """A subscriber to what is kept, too, in the order in which each sender told it, once each."""
    return ext.declare_advanced_subscriber(
        session,
        key,
        callback,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=newest),
        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )


def told_ns(sample: zenoh.Sample, now_ns: int) -> int:
    """When it was told: now, or earlier if it was fetched, as far as the sender's UTC goes."""
    if sample.congestion_control != FETCHED or sample.timestamp is None:
        return now_ns
    age_ns = time.time_ns() - sample.timestamp.get_time_as_ntp64().as_nanos()
    return now_ns - max(0, age_ns)
