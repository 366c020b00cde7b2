"""Whom Zenoh kept out, and why, read out of its log and told in words that help."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from itertools import islice
from types import MappingProxyType
from typing import Final, NamedTuple

from protocol.bus.access import grant_of

QUIET_NS: Final = 60_000_000_000
"""What was told is not told again for so long, only counted."""

AT_ONCE: Final = 10
MOST_LINES: Final = 3000
REMEMBERED: Final = 500
SIGNS: Final = (b"is unauthorized to", b". Hint: ")
"""Of a line that counts. Most of the log says what was allowed, and is not looked at closer."""

DENIED: Final = re.compile(
    r"access_control: (?P<known>Using cached result: )?(?P<zid>[0-9a-f]{1,32})"
    r"(?: on \S*)? is unauthorized to (?P<what>[A-Z][A-Za-z/ ]+) \(ingress\) on (?P<key>\S+)"
)
UNWELCOME: Final = re.compile(r"zenoh_link_tls::unicast: (?P<why>.+)\. Hint: ")
LEARNT: Final = "Declare/Undeclare"
"""Zenoh works out all that may be done with a key at once, and tells of that as of refusals."""

WOULD: Final[Mapping[str, str]] = MappingProxyType(
    {
        "Put": "put on",
        "Delete": "delete",
        "Query": "ask",
        "Reply": "answer on",
        "Declare Subscriber": "listen to",
        "Declare Queryable": "serve",
        "Liveliness Token": "show itself as",
        "Liveliness Query": "look who is at",
        "Declare Liveliness Subscriber": "look who is at",
    }
)
WHEN: Final = re.compile(r"not valid (?P<which>after|before) (?P<s>\d+)")
REASONS: Final = (
    ("InvalidContentType", "it speaks plain TCP, and this door takes only TLS"),
    ("peer sent no certificates", "it shows no certificate"),
    ("UnknownIssuer", "its certificate is signed by another authority"),
    ("BadSignature", "its certificate is signed by another authority"),
    ("InvalidPurpose", "its certificate is not one to dial with"),
    ("received fatal alert", "it does not believe the certificate that it was shown"),
)
NOBODY: Final = ("handshake eof", "reset by peer", "Broken pipe", "end of file")
"""Somebody who only looked whether the door is there."""


class Caller(NamedTuple):
    """Who dialled: the common name of the certificate, and from where."""

    name: str
    address: str


UNKNOWN: Final = Caller("somebody", "an unknown address")


class Refusals:
    """Says each refusal once, and how often it was repeated when it is told again."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[int, int]] = {}  # when (ns), how often since

    def heard(
        self,
        log: bytes,
        caller: Callable[[str], Caller],
        strangers: Callable[[], Iterable[str]],
        now_ns: int,
    ) -> list[str]:
        """What there is to tell of a piece of the log, in whole lines.

        `caller` knows who has a session id; `strangers` looks where calls came to nothing.
        """
        plain = telling(log)
        known = (*denials(plain, caller), *unwelcome(plain, strangers))
        fresh = [told for sentence in known if (told := self._once(sentence, now_ns))]
        while len(self._told) > REMEMBERED:
            del self._told[next(iter(self._told))]
        if len(fresh) > AT_ONCE:
            return [*fresh[:AT_ONCE], f"refused: {len(fresh) - AT_ONCE} others at the same time"]
        return fresh

    def _once(self, sentence: str, now_ns: int) -> str:
        """The sentence, or nothing when it was told lately."""
        at_ns, again = self._told.get(sentence, (None, 0))
        if at_ns is not None and now_ns - at_ns < QUIET_NS:
            self._told[sentence] = at_ns, again + 1
            return ""
        self._told[sentence] = now_ns, 0
        return f"{sentence} ({again} more times since it was told)" if again else sentence


def telling(log: bytes) -> str:
    """The lines that tell of a refusal; of a flood only the beginning is looked at."""
    if not any(sign in log for sign in SIGNS):
        return ""
    lines = (line for line in log.splitlines() if any(sign in line for sign in SIGNS))
    return b"\n".join(islice(lines, MOST_LINES)).decode(errors="replace")


def denials(log: str, caller: Callable[[str], Caller]) -> Iterator[str]:
    """What somebody wanted to do who was let in, but may not."""
    found = list(DENIED.finditer(log))
    learnt = {(one["zid"], one["key"]) for one in found if one["what"].startswith(LEARNT)}
    for one in found:
        if one["what"] not in WOULD or (not one["known"] and (one["zid"], one["key"]) in learnt):
            continue
        name, address = caller(one["zid"])
        grant = grant_of(name)
        may = f"{name} {grant.says}" if grant else "no role has the name of its certificate"
        yield f"refused: {name} at {address} may not {WOULD[one['what']]} {one['key']}: {may}"


def unwelcome(log: str, strangers: Callable[[], Iterable[str]]) -> Iterator[str]:
    """Who was not let in at all. Of these Zenoh does not tell the address."""
    found = [one["why"] for one in UNWELCOME.finditer(log)]
    whys = [why for why in found if not any(words in why for words in NOBODY)]
    address = (", ".join(strangers()) if whys else "") or UNKNOWN.address
    for why in whys:
        yield f"not let in: {UNKNOWN.name} at {address}: {in_words(why)}"


def in_words(why: str) -> str:
    """Why a handshake failed."""
    when = WHEN.search(why)
    if when:
        moment = f"{datetime.fromtimestamp(int(when['s']), UTC):%Y-%m-%d %H:%M} UTC"
        expired = when["which"] == "after"
        return (
            f"its certificate expired at {moment}"
            if expired
            else f"its certificate is not valid before {moment}; compare the clocks"
        )
    return next((words for sign, words in REASONS if sign in why), why)
