"""The signing of one gateway: its keys, the check of received frames, signatures of sent ones."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gateways.mavlink.clients.framing import Frame
from gateways.mavlink.signing.policy import Counters, Policy, Rights, count, rights_of
from gateways.mavlink.signing.stamps import StampClock
from gateways.mavlink.signing.verifier import Verdict, Verifier
from ground.user.mavlink_keys import KeyRing, SigningKey

Save = Callable[[KeyRing], None]


class SigningGuard:
    """Used by all clients and vehicles of a gateway.

    `policies` are those of the endpoints by their text, LOOPBACK by default. `save` keeps keys that
    a client has set.
    """

    def __init__(
        self,
        unix_ns: Callable[[], int],
        ring: KeyRing | None = None,
        policies: Mapping[str, Policy] | None = None,
        *,
        save: Save = lambda _: None,
        stamps: Path | None = None,
        write_stamp: Callable[[Path, int], None] | None = None,
    ) -> None:
        self._policies = dict(policies or {})
        self._clock = StampClock(unix_ns, stamps, write_stamp)
        self._verifier = Verifier(self._clock)
        self._save = save
        self._armed: list[Callable[[], bool]] = []
        self._use(ring or KeyRing())

    @property
    def is_signing(self) -> bool:
        """True if there is a key, so that all frames are signed."""
        return self._current is not None

    @property
    def is_required(self) -> bool:
        """True if an endpoint takes commands only from clients that sign."""
        return Policy.REQUIRE in self._policies.values()

    @property
    def is_any_armed(self) -> bool:
        """True if a robot of the gateway is armed; all of them have the same key."""
        return any(is_armed() for is_armed in self._armed)

    def watch(self, is_armed: Callable[[], bool]) -> None:
        """Add a robot."""
        self._armed.append(is_armed)

    def check(
        self, frame: Frame, counters: Counters, endpoint: str, *, is_loopback: bool
    ) -> tuple[Rights, Verdict]:
        """Count a received frame; return its rights, and the verdict on its signature."""
        verdict = self._verifier.check(frame)
        count(counters, verdict)
        policy = self._policies.get(endpoint, Policy.LOOPBACK)
        return rights_of(verdict, policy, is_loopback=is_loopback), verdict

    def prepare(self, encoder: Any) -> None:
        """Set up pymavlink to sign the next frame of an encoder, if there is a key."""
        signing = encoder.signing
        signing.sign_outgoing = self._current is not None
        if self._current is not None:
            signing.secret_key = self._current
            signing.timestamp = self._clock.next()

    def replace_key(self, secret: bytes | None) -> None:
        """Replace all keys by this one, or by none; OSError and UserError if it cannot be saved."""
        ring = KeyRing(key=() if secret is None else (SigningKey(secret=secret.hex()),))
        self._save(ring)
        self._use(ring)

    def is_current(self, secret: bytes) -> bool:
        """Return whether this key signs."""
        return self._current == secret

    def _use(self, ring: KeyRing) -> None:
        keys = tuple(key.raw for key in ring.key)
        self._current = keys[0] if keys else None
        self._verifier.keys = keys
