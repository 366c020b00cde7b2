"""The images, built once; where there is no docker these tests are skipped, which CI forbids."""

from collections.abc import Iterator
from uuid import uuid4

import pytest

from tests.support.compose.compose import BUILD_S, Compose, docker, project, why_no_docker


@pytest.fixture(scope="session")
def image() -> Iterator[str]:
    """Build the image of this tree; remove its name afterwards, and keep its layers cached."""
    why = why_no_docker()
    if why:
        pytest.skip(why)
    name = f"sidestep:test-{uuid4().hex[:8]}"
    Compose(name).does("build", "router", within_s=BUILD_S)
    yield name
    docker("rmi", "--force", name)


@pytest.fixture(scope="module")
def stack(image: str) -> Iterator[Compose]:
    """Start what `docker compose up` starts and wait until it is healthy, once per file."""
    with project(image) as compose:
        compose.up()
        yield compose
