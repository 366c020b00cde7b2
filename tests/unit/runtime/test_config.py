"""Configuration errors contain file, key, reason and fix."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import pytest
from msgspec import Meta

from protocol.bus.network import Network
from runtime.config import load, load_shared, parse
from runtime.errors import ConfigError, LocalError


@dataclass(frozen=True, kw_only=True)
class Robot:
    id: str
    rate_hz: Annotated[float, Meta(ge=1.0, le=100.0)] = 20.0
    gain: float = 1.0
    network: Network = field(default_factory=Network)


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_becomes_typed_settings(tmp_path: Path) -> None:
    text = """
    id = "r2"
    rate_hz = 10
    [network]
    mode = "client"
    connect = ["tcp/127.0.0.1:7447"]
    """
    robot = load(written(tmp_path, text), Robot)
    network = Network(mode="client", connect=("tcp/127.0.0.1:7447",))
    assert robot == Robot(id="r2", rate_hz=10.0, network=network)


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ('id = "r"\nrate_h = 3', "rate_h", "unknown key; did you mean 'rate_hz'?"),
        ('id = "r"\nzzz = 3', "zzz", "unknown key; known keys: gain, id, network, rate_hz"),
        ('id = "r"\n[network]\nmod = "peer"', "network.mod", "did you mean 'mode'?"),
        ("", "id", "missing key; add it"),
        ("id = 3", "id", "expected `str`, got `int`"),
        ('id = "r"\nrate_hz = 200', "rate_hz", "expected `float` <= 100"),
        ('id = "r"\nrate_hz = true', "rate_hz", "expected `float`, got `bool`"),
        ('id = "r"\ngain = nan', "gain", "is not finite; give a finite number"),
        ('id = "r"\ngain = -inf', "gain", "is not finite"),
        ('id = "r"\nnetwork = 3', "network", "expected `object`, got `int`"),
        ('id = "r"\n[network]\nmode = "pear"', "network.mode", "'client', 'peer', 'router'"),
        ('id = "r"\n[network]\nlisten = ["banana"]', "network", "endpoint 'banana': write it as"),
        ("id = ", "", "Invalid value"),
    ],
)
def test_a_mistake_is_named_with_file_key_reason_and_fix(
    tmp_path: Path, text: str, key: str, words: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load(path, Robot)
    assert caught.value.key == key
    assert caught.value.file == str(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there_is_named() -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml: no such file"):
        load("nowhere.toml", Robot)


def test_a_file_that_is_not_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load(path, Robot)


def test_a_configuration_error_is_the_users_and_ends_with_code_2() -> None:
    with pytest.raises(LocalError) as caught:
        parse({"robot": 1}, Robot, file="x.toml")
    assert isinstance(caught.value, ConfigError)
    assert caught.value.exit_code == 2


@dataclass(frozen=True, kw_only=True)
class OnlyNetwork:
    network: Network | None = None


def test_keys_of_other_processes_in_a_shared_file_are_ignored(tmp_path: Path) -> None:
    text = 'robot = 3\n[network]\nprefix = "a"\n[parameters]\nfoo = 1'
    found = load_shared(written(tmp_path, text), OnlyNetwork)
    assert found.network == Network(prefix="a")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[paramters]", "paramters: unknown key; did you mean 'parameters'?"),
        ("zzz = 1", "zzz: unknown key; known keys: gateway, network, parameters, robot"),
        ('[network]\nmod = "peer"', "network.mod: unknown key; did you mean 'mode'?"),
    ],
)
def test_in_a_shared_file_a_misspelt_name_is_still_refused(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        load_shared(written(tmp_path, text), OnlyNetwork)
    assert words in str(caught.value)
