"""Liveliness tokens: only tokens with a valid robot, role and session are accepted."""

import threading
from collections.abc import Set as AbstractSet
from typing import Any

from protocol.bus.bus import Presence, TokenSet, presence_in
from tests.support.each import each
from tests.support.hostile import TEXT


def test_token_contains_robot_role_and_session() -> None:
    assert presence_in("sidestep/r1/alive/robot/4f2a") == Presence("r1", "robot", "4f2a")
    assert presence_in("a/b/r-2/alive/ground/0") == Presence("r-2", "ground", "0")


@each(
    "key",
    [
        f"sidestep/r{TEXT}/alive/robot/4f2a",
        f"sidestep/r1/alive/{TEXT}/4f2a",
        f"sidestep/r1/alive/robot/{TEXT}",
        "sidestep/r1\n/alive/robot/4f2a",
        "sidestep/R1/alive/robot/4f2a",
        f"sidestep/{'r' * 17}/alive/robot/4f2a",
        "sidestep/r1/alive/nobody/4f2a",
        f"sidestep/r1/alive/robot/{'0' * 33}",
        "sidestep//alive/robot/4f2a",
    ],
)
def test_malformed_token_is_ignored(key: str) -> None:
    assert presence_in(key) is None


FIRST, SECOND, THIRD = (Presence("r1", "robot", zid) for zid in ("1", "2", "3"))


class Interrupted(frozenset[Presence]):
    """A set in which another thread adds a token just before each change."""

    other: threading.Thread

    def interrupt(self) -> None:
        if self.other.ident is None:
            self.other.start()
            self.other.join(timeout=0.2)

    def __or__(self, others: AbstractSet[Any]) -> frozenset[Any]:
        self.interrupt()
        return super().__or__(others)

    def __sub__(self, others: AbstractSet[Any]) -> frozenset[Presence]:
        self.interrupt()
        return super().__sub__(others)


@each(("came", "there"), [(True, [FIRST, SECOND, THIRD]), (False, [THIRD])])
def test_tokens_added_by_two_threads_at_once_are_all_kept(
    came: bool, there: list[Presence]
) -> None:
    """Keep each token: a lost one hid a second robot of one name, or kept it for ever."""
    seen: list[Presence] = []
    tokens = TokenSet(lambda who, _: seen.append(who))
    tokens.there = before = Interrupted({FIRST})
    before.other = threading.Thread(target=tokens.take, args=(THIRD,), kwargs={"appeared": True})
    tokens.take(SECOND if came else FIRST, appeared=came)
    before.other.join()
    assert sorted(tokens.there) == there
    assert seen == [SECOND if came else FIRST, THIRD]
