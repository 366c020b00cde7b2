"""Short words replace verbs of the command line, and only those."""

from ground.console.app_commands import LOCAL
from ground.console.parser import ALIASES, PAIRS, expanded
from runtime.cli.verb_table import VERBS
from tests.support.each import each


@each(
    ("words", "meant"),
    [
        (["goal", "1", "2"], ["goto", "1", "2"]),
        (["set", "side", "1"], ["param", "set", "side", "1"]),
        (["get", "d_*"], ["param", "get", "d_*"]),
        (["mode", "RTL"], ["rtl"]),
        (["mode", "AUTO"], ["mode", "AUTO"]),
        (["mission", "restart"], ["mission", "start", "1"]),
        (["record", "mark", "here"], ["mark", "here"]),
        (["record", "start"], ["record", "start"]),
        (["rec", "start"], ["record", "start"]),
        (["rec", "plot", "x.tlog"], ["plot", "x.tlog"]),
        (["plot", "x.tlog"], ["plot", "x.tlog"]),
        (["wp", "upload", "--json"], ["mission", "upload", "-", "--json"]),
        (["hold"], ["hold"]),
        (["flap", "wings"], ["flap", "wings"]),
    ],
)
def test_short_word_replaces_the_long_one(words: list[str], meant: list[str]) -> None:
    assert expanded(words) == meant


def test_every_alias_means_something_and_hides_nothing() -> None:
    for meant in (*ALIASES.values(), *PAIRS.values()):
        assert meant[0] in {*VERBS, *LOCAL}
    assert not set(ALIASES) & {*VERBS, *LOCAL}
