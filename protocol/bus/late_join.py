"""Events outlive a cut: who tells them keeps the newest, who listens fetches what it has missed.

By Zenoh's advanced publishers and subscribers, on the keys `KEY/@adv/...` beside each such key.
What was fetched is known from what has just been told, and says when it was told.
"""

import logging
import time
from collections.abc import Callable
from threading import Lock, Thread
from typing import Any, Final, TypeAlias

import zenoh
from zenoh import ext
from zenoh.handlers import Callback

LOG = logging.getLogger(__name__)
Take: TypeAlias = Callable[[zenoh.Sample], None]
Source: TypeAlias = tuple[str, int]
"""A sender: its session and its number there."""

BEAT_S: Final = 0.5
"""So often its sender tells how many events there were; the last before a silence is missed no
later than that."""

TOLD: Final = zenoh.CongestionControl.DROP
FETCHED: Final = zenoh.CongestionControl.BLOCK
"""What tells the two apart on arrival: an answer looks as the question did, and questions of
advanced subscribers are asked like that. How it is really sent is up to `congestion`."""

FETCH_S: Final = 2.0
FETCHES: Final = 16
"""At a time; whoever makes up more senders than that gets no more threads."""
MAX_WAITING: Final = 1000
"""Samples of one sender that wait until its earlier ones are fetched; more are dropped."""

SOURCES: Final = 1000
"""So many senders are remembered; of later ones the beginning is what Zenoh makes of it."""


def keeping(
    session: zenoh.Session, key: str, newest: int, **service: Any
) -> "ext.AdvancedPublisher":
    """A publisher that keeps so many of its newest samples for whoever asks for them."""
    return ext.declare_advanced_publisher(
        session,
        key,
        congestion_control=TOLD,
        cache=ext.CacheConfig(newest),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=BEAT_S, sporadic_heartbeat=None),
        publisher_detection=True,
        **service,
    )


def following(session: zenoh.Session, key: str, newest: int, take: Take) -> Any:
    """A subscriber to what is kept, too, in the order in which each sender told it, once each."""
    whole = LateJoin(lambda source: fetched(session, key, newest, source), take)
    return ext.declare_advanced_subscriber(
        session,
        key,
        Callback(whole.hear, indirect=False),
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=newest),
        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )


class LateJoin:
    """Hands on what is heard of each sender, from its beginning.

    Zenoh 1.10 drops what it has fetched of a sender when the first live sample comes after the
    first answer and before the second one, which it asks for when it detects the sender. A sender
    of whom a later sample is heard first is waited for until what was before is fetched.
    """

    def __init__(self, fetch: Callable[[Source], list[zenoh.Sample]], take: Take) -> None:
        self._fetch, self._take = fetch, take
        self._lock = Lock()
        self._known: set[Source] = set()
        self._waiting: dict[Source, list[zenoh.Sample]] = {}

    def hear(self, sample: zenoh.Sample) -> None:
        """Called from the bus, for one sample after the other."""
        source = source_of(sample)
        with self._lock:
            if source in self._waiting:
                if len(self._waiting[source]) < MAX_WAITING:
                    self._waiting[source].append(sample)
            elif source is not None and self._lacks(source, sample):
                self._waiting[source] = [sample]
                Thread(target=self._complete, args=(source, number_of(sample)), daemon=True).start()
            else:
                self._take(sample)

    def _lacks(self, source: Source, sample: zenoh.Sample) -> bool:
        """Is this the first of its sender, told just now, and not the first that was told?"""
        if source in self._known or len(self._known) >= SOURCES:
            return False
        self._known.add(source)
        live = sample.congestion_control != FETCHED
        return live and number_of(sample) > 0 and len(self._waiting) < FETCHES

    def _complete(self, source: Source, first: int) -> None:
        """Whatever comes of asking, those that wait are heard."""
        before: list[zenoh.Sample] = []
        try:
            before = [sample for sample in self._fetch(source) if number_of(sample) < first]
        except Exception:
            LOG.exception("what a sender told before could not be fetched")
        with self._lock:
            for sample in (*sorted(before, key=number_of), *self._waiting.pop(source)):
                self._take(sample)


def source_of(sample: zenoh.Sample) -> Source | None:
    """None: it was not told by a publisher that keeps its samples."""
    info = sample.source_info
    return None if info is None else (str(info.source_id.zid), info.source_id.eid)


def number_of(sample: zenoh.Sample) -> int:
    """Of its sender's samples, from 0."""
    info = sample.source_info
    return 0 if info is None else info.source_sn


def fetched(session: zenoh.Session, key: str, newest: int, source: Source) -> list[zenoh.Sample]:
    """What a sender has kept; nothing when it does not answer any more."""
    zid, number = source
    try:
        replies = session.get(
            f"{key}/@adv/pub/{zid}/{number}/**?_max={newest}",
            timeout=FETCH_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )
        return [reply.ok for reply in replies if reply.ok is not None]
    except zenoh.ZError:  # the session was closed
        return []


def was_fetched(sample: zenoh.Sample) -> bool:
    """Return whether it was told before, and kept for those who come later."""
    return bool(sample.congestion_control == FETCHED)


def told_ns(sample: zenoh.Sample, now_ns: int) -> int:
    """When it was told: now, or earlier if it was fetched, as far as the sender's UTC goes."""
    if not was_fetched(sample) or sample.timestamp is None:
        return now_ns
    age_ns = time.time_ns() - sample.timestamp.get_time_as_ntp64().as_nanos()
    return now_ns - max(0, age_ns)
