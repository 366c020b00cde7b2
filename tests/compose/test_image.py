"""The image: small, complete, compiled, and without secrets; and the one with tree and tools."""

import json
import re
from collections.abc import Iterator
from typing import Final

import pytest

from tests.support.compose import images
from tests.support.compose.compose import Compose, Done, docker, project, tried

pytestmark = pytest.mark.compose

MOST_MB: Final = 500
SECRETS: Final = re.compile(r"-----BEGIN|token=|password|index-url|index_url|://[^ ]*@", re.I)
MISSING: Final = """
from importlib.metadata import distributions, requires, version
import re
for distribution in distributions():
    for wanted in distribution.requires or ():
        if "extra ==" not in wanted and "python_version" not in wanted:
            version(re.match(r"[A-Za-z0-9._-]+", wanted)[0])
print("complete")
"""
UNCOMPILED: Final = """
from pathlib import Path
import sys
places = [Path(path) for path in sys.path if path.startswith("/opt")]
modules = [file for place in places for file in place.rglob("*.py")]
bare = [file for file in modules
        if not list((file.parent / "__pycache__").glob(file.stem + ".cpython-*.pyc"))]
print(len(modules), *bare)
"""


def within(image: str, *words: str) -> Done:
    """Run a program of the image without network and privileges."""
    alone = ("--rm", "--read-only", "--network=none", "--cap-drop=ALL", "--entrypoint", words[0])
    return tried(
        ["docker", "run", *alone, image, *words[1:]], {"PATH": "/usr/local/bin:/usr/bin"}, 60
    )


def python(image: str, script: str) -> str:
    done = within(image, "python", "-c", script)
    assert done.code == 0, done.said
    return done.said


def test_it_is_small(image: str) -> None:
    size_mb = json.loads(docker("image", "inspect", image))[0]["Size"] / 1e6
    assert size_mb < MOST_MB, f"{size_mb:.0f} MB"


def test_image_runs_as_an_unprivileged_user(image: str) -> None:
    assert within(image, "id", "-u").said.strip() == "10001"
    assert within(image, "sidestep", "--version").said.startswith("sidestep 0.")


def test_all_that_its_packages_want_is_there(image: str) -> None:
    assert python(image, MISSING).strip() == "complete"


def test_what_only_makes_and_tests_it_is_not(image: str) -> None:
    modules = ("sidestep", "pip", "pytest", "mypy", "hatchling")
    script = f"from importlib.util import find_spec; print(*filter(find_spec, {modules}))"
    assert python(image, script).strip() == "sidestep"


def test_its_modules_are_compiled(image: str) -> None:
    modules, *bare = python(image, UNCOMPILED).split()
    assert int(modules) > 1000
    assert bare == []


def test_no_secret_is_in_its_history_or_its_settings(image: str) -> None:
    history = docker("history", "--no-trunc", "--format", "{{.CreatedBy}}", image)
    assert "useradd" in history
    assert not SECRETS.search(history)
    assert not SECRETS.search(docker("image", "inspect", image))


def test_no_key_is_in_its_files(image: str) -> None:
    places = ("/opt/sidestep", "/etc/sidestep", "/home", "/keys", "/state", "/root", "/run")
    sought = ("(", "-name", "*.key", "-o", "-name", "*.pem", "-o", "-name", "pip.conf", ")")
    done = within(image, "find", *places, *sought, "-type", "f")
    assert [line for line in done.said.splitlines() if line.startswith("/")] == []


@pytest.fixture(scope="module")
def checkout(image: str) -> Iterator[Compose]:
    """Build the image with the tree and the tools."""
    with project(images.image("tests")) as compose:
        yield compose


def test_measurements_run_in_the_image_with_the_tree(checkout: Compose) -> None:
    done = checkout.tries("run", "--rm", "-T", "bench", "codec")
    assert done.code == 0, done.said


def test_the_tests_run_in_the_image_with_the_tree(checkout: Compose) -> None:
    modules = ("tests/bus/test_refusals.py", "tests/stack/test_operator.py")
    chosen = ("-k", "valid_certificate or poor and environment0")
    done = checkout.tries("run", "--rm", "-T", "tests", "-q", *modules, *chosen)
    assert (done.code, "2 passed" in done.said) == (0, True), done.said
