"""The images of the tests with containers: why there are none, and what an image is made of."""

from pathlib import Path

import pytest

from checks.built import ROOT
from tests.support.compose import images


@pytest.fixture
def docker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the path of a command `docker` that is the only one."""
    monkeypatch.setenv("PATH", str(tmp_path))
    return tmp_path / "docker"


def plays(docker: Path, script: str) -> None:
    docker.write_text(f"#!/bin/sh\n{script}\n")
    docker.chmod(0o755)


def test_missing_client_is_named(docker: Path) -> None:
    with pytest.raises(images.NoEngineError, match="no docker on this machine"):
        images.require_engine(0.0)


def test_client_without_an_engine_is_named_with_its_words(docker: Path) -> None:
    plays(docker, 'echo "Cannot connect to the Docker daemon"; exit 1')
    with pytest.raises(images.NoEngineError, match="docker info: Cannot connect to the Docker"):
        images.require_engine(0.0)


def test_missing_base_image_is_named(docker: Path) -> None:
    plays(docker, 'case $1 in image|pull) echo "no route to registry"; exit 1;; esac')
    base = images.base_image()
    with pytest.raises(images.NoEngineError, match=f"no base image {base}: .*no route"):
        images.require_engine(0.0)


def test_base_image_that_appears_is_waited_for(docker: Path) -> None:
    plays(
        docker,
        'case $1 in image|pull) [ -e "$0.base" ] || { : >"$0.base"; exit 1; };; esac',
    )
    images.require_engine(60.0)


def test_image_of_the_product_is_made_of_what_the_dockerfile_copies() -> None:
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    words = [word for line in lines if line.startswith("COPY ") for word in line.split()[1:-1]]
    copied = {word.rstrip("/") for word in words if (ROOT / word).exists() and word != "."}
    assert {name.partition("/")[0] for name in copied} <= set(images.PRODUCT)
    found = {path.relative_to(ROOT).as_posix() for path in images.context("runtime")}
    assert {"Dockerfile", "docker/install", "robot/core/brain.py"} <= found
    assert found < {path.relative_to(ROOT).as_posix() for path in images.context("tests")}
