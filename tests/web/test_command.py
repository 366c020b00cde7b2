"""Test the command line of each browser's app, and addresses that are in use."""

import socket
from contextlib import closing
from pathlib import Path

import pytest

from ground.cli.main import parse
from ground.web import Address, refuse_taken, words_of
from runtime.errors import UserError
from tests.support.each import each


@each(
    "words",
    [
        [],
        ["--id", "r2", "--connect", "tcp/127.0.0.1:7000"],
        ["--theme", "light", "--hz", "5.0", "--ascii"],
        ["--record", "logs", "--keys", "keys.toml", "--config", "all.toml"],
        ["--no-record"],
    ],
)
def test_browsers_get_the_options_of_the_command_line(words: list[str]) -> None:
    wanted = parse(["ground", *words])
    given = parse(words_of(parse(["ground", "--web", "9000", "--token-file", "t", *words])))
    assert vars(given) == vars(wanted)
    assert given.web is None


def test_every_other_option_is_passed_on() -> None:
    own = {"verb", "web", "token_file", "json", "plain"}
    words = ["--connect", "c", "--id", "i", "--config", "f", "--record", "d", "--theme", "dark"]
    full = parse(["ground", "--web", "1", *words, "--hz", "2", "--keys", "k", "--ascii"])
    again = parse(words_of(full))
    assert {name for name in vars(full) if vars(full)[name] != vars(again)[name]} <= own
    assert again.keys == Path("k")


def test_address_in_use_is_refused() -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f"{port}.*choose another port"):
            refuse_taken(Address("127.0.0.1", port))
    refuse_taken(Address("127.0.0.1", port))
