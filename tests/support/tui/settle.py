"""Textual in tests: wait until an app has nothing to do, and parse each style sheet once."""

import asyncio
from math import inf
from typing import Any, Final

import pytest
from textual.css.model import RuleSet
from textual.css.stylesheet import Stylesheet

SOON_S: Final = 0.02
"""A timer that is due within this time is waited for, as Textual's own pilot does."""
ROUNDS: Final = 2
MAX_TIMERS: Final = 50
"""A timer that repeats quickly is not waited for any longer: for 1 s if it is due in `SOON_S`."""

parse_rules: Final = Stylesheet._parse_rules
parsed: Final[dict[object, list[RuleSet]]] = {}


def hasten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let Textual's pilot wait for the event loop, and share style sheets between apps."""
    monkeypatch.setattr("textual.pilot.wait_for_idle", settled)
    monkeypatch.setattr("textual.app.wait_for_idle", settled)
    monkeypatch.setattr(Stylesheet, "_parse_rules", parsed_once)


async def settled(*_: float) -> None:
    """Return when no callback is ready and no timer is due soon.

    In place of `textual._wait.wait_for_idle`, which sleeps 20 ms, and again for up to 1 s while the
    process uses the processor. A busy machine changes nothing here: callbacks are awaited as long
    as there are any, and timers are counted.
    """
    loop: Any = asyncio.get_running_loop()
    quiet = timers = 0
    while quiet < ROUNDS:
        await asyncio.sleep(0)
        quiet = 0 if loop._ready else quiet + 1
        if quiet == ROUNDS and timers < MAX_TIMERS:
            waiting = [timer.when() for timer in loop._scheduled if not timer.cancelled()]
            wait_s = min(waiting, default=inf) - loop.time()
            if wait_s < SOON_S:
                await asyncio.sleep(max(0.0, wait_s))
                quiet, timers = 0, timers + 1


def parsed_once(sheet: Stylesheet, css: str, *where: Any, **how: Any) -> list[RuleSet]:
    """Return the rules of a style sheet, which is parsed again for other variables only."""
    key = (css, where, tuple(how.items()), tuple(sheet._variables.items()))
    if key not in parsed:
        parsed[key] = parse_rules(sheet, css, *where, **how)
    return parsed[key]
