"""`sidestep keys signing`: no action prints a secret unless it is asked for."""

import argparse
import json
from pathlib import Path

import pytest

from ground.cli.run.signing_keys import arguments, run
from ground.text.output import Output
from ground.user.mavlink_keys import read_keys
from runtime.errors import UserError


class Verb:
    def __init__(self, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.path, self._capsys = path, capsys

    def __call__(self, *words: str, as_json: bool = False) -> str:
        parser = argparse.ArgumentParser()
        arguments(parser)
        options = parser.parse_args([*words, "--file", str(self.path)])
        assert run(options, Output(as_json=as_json)) == 0
        return self._capsys.readouterr().out

    @property
    def secrets(self) -> list[str]:
        ring = read_keys(self.path)
        return [text for key in ring.key for text in (key.secret, key.passphrase)]


@pytest.fixture
def verb(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Verb:
    return Verb(tmp_path / "keys.toml", capsys)


def test_rotation_keeps_the_old_key_until_it_is_retired(verb: Verb) -> None:
    printed = verb("show") + verb("new")
    (first,) = read_keys(verb.path).key
    printed += verb("show") + verb("rotate") + verb("show")
    second, kept = read_keys(verb.path).key
    assert kept == first != second
    assert not [text for text in verb.secrets if text in printed]
    printed = verb("retire")
    assert read_keys(verb.path).key == (second,)
    assert not [text for text in verb.secrets if text in printed]


def test_secret_is_printed_only_on_request(verb: Verb) -> None:
    verb("new")
    assert all(text in verb("show", "--secret") for text in verb.secrets)
    row = json.loads(verb("show", "--secret", as_json=True))
    assert [row["keys"][0]["key"], row["keys"][0]["passphrase"]] == verb.secrets
    assert "key" not in json.loads(verb("show", as_json=True))["keys"][0]


@pytest.mark.parametrize(
    ("steps", "fix"),
    [
        (("new", "new"), "signing rotate"),
        (("rotate",), "signing new"),
        (("new", "rotate", "rotate"), "signing retire"),
        (("new", "retire"), "no old key"),
    ],
)
def test_wrong_order_is_refused_with_the_fix(verb: Verb, steps: tuple[str, ...], fix: str) -> None:
    for step in steps[:-1]:
        verb(step)
    with pytest.raises(UserError, match=fix):
        verb(steps[-1])


def test_secret_only_with_show(verb: Verb) -> None:
    with pytest.raises(UserError, match="keys signing show"):
        verb("new", "--secret")
