"""Without an endpoint, a verb uses the only run of `up` that is here."""

from pathlib import Path

import pytest

from ground.cli.main import parse
from ground.cli.options import common_of
from ground.client.connection import START_HINT, UP_HINT, common
from ground.client.vocabulary import PYTHON
from ground.text.output import Output
from runtime.errors import UserError
from tests.support.ground.runs import ENDPOINT, written

OTHER = "tcp/127.0.0.1:40000"


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


def test_the_only_run_is_used(capsys: pytest.CaptureFixture[str]) -> None:
    file = written()
    found = common_of(parse(["hold"]), Output(as_json=False))
    assert (found.endpoint, found.robot) == (ENDPOINT, "r1")
    assert capsys.readouterr() == ("", f"run box at {ENDPOINT}\n")
    file.remove()
    assert common_of(parse(["hold"])).endpoint == "tcp/127.0.0.1:7447"


@pytest.mark.parametrize("verb", ["doctor", "watch", "ground", "ghost", "explain"])
def test_every_verb_that_dials_finds_it(verb: str) -> None:
    written()
    words = [verb, "--navigator", "bug"] if verb == "ghost" else [verb]
    assert common_of(parse(words)).endpoint == ENDPOINT


def test_an_endpoint_or_a_file_that_is_given_wins(tmp_path: Path) -> None:
    written()
    assert common_of(parse(["hold", "--connect", OTHER])).endpoint == OTHER
    file = tmp_path / "ground.toml"
    file.write_text(f'[network]\nconnect = ["{OTHER}"]\n')
    assert common_of(parse(["hold", "--config", str(file)])).endpoint == OTHER


def test_a_file_without_an_endpoint_means_the_usual_one(tmp_path: Path) -> None:
    written()
    file = tmp_path / "ground.toml"
    file.write_text('robot = "r2"\n')
    found = common_of(parse(["hold", "--config", str(file)]))
    assert (found.endpoint, found.robot) == ("tcp/127.0.0.1:7447", "r2")


def test_several_runs_are_listed_and_one_is_chosen_by_name() -> None:
    written()
    written(OTHER, "u_trap")
    with pytest.raises(UserError) as caught:
        common_of(parse(["hold"]))
    for word in ("box", ENDPOINT, "u_trap", OTHER, "--run NAME", "--connect"):
        assert word in str(caught.value)
    assert common_of(parse(["hold", "--run", "u_trap"])).endpoint == OTHER
    assert common_of(parse(["hold", "--connect", "tcp/h:1"])).endpoint == "tcp/h:1"


def test_one_of_several_runs_is_chosen_in_the_words_of_python() -> None:
    written()
    written(OTHER, "u_trap")
    with pytest.raises(UserError) as caught:
        common(None, None, None, remedies=PYTHON)
    assert f"choose one with sidestep.connect({ENDPOINT!r})" in str(caught.value)
    assert "--" not in str(caught.value)


def test_an_unknown_run_is_refused_with_those_that_are_there() -> None:
    with pytest.raises(UserError, match=r"--run box: there is no such run; nothing runs here"):
        common_of(parse(["hold", "--run", "box"]))
    written()
    with pytest.raises(UserError, match=rf"here run: box \({ENDPOINT}\)"):
        common_of(parse(["hold", "--run", "bax"]))


def test_a_run_and_an_endpoint_exclude_each_other() -> None:
    written()
    for words in (["--run", "box", "--connect", OTHER], ["--run", "box", "--context", "lab"]):
        with pytest.raises(UserError, match="use only one of --connect"):
            common_of(parse(["hold", *words]))


def test_a_run_with_certificates_needs_no_file(tmp_path: Path) -> None:
    (tmp_path / "ground.toml").write_text(
        '[network.tls]\nca = "ca.pem"\ncertificate = "g.pem"\nkey = "g.key"\n'
    )
    written("tls/127.0.0.1:5000", locks=str(tmp_path))
    found = common_of(parse(["hold"]))
    assert found.network.tls is not None
    assert found.network.tls.certificate == str(tmp_path / "g.pem")
    assert found.config == str(tmp_path / "ground.toml")


def test_without_a_run_the_error_names_the_next_command() -> None:
    assert common_of(parse(["hold"])).hint == START_HINT
    assert common_of(parse(["hold", "--connect", OTHER])).hint == UP_HINT
