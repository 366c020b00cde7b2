"""`python -m tests.support.images`: build the images, unless this tree's are there already.

An image has the hash of the files that it is made of in its name, so an unchanged tree is not built
again. The newest few are kept. An engine that is being set up at the same time is waited for, and
so is the base image.
"""

import fcntl
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from checks.built import cache, key_of
from checks.harness.until import until
from tests.support.compose import BUILD_S, ROOT, Compose, docker, tried

SETUP_S: Final = 300.0
"""Time for the engine and the base image in CI, where both may be set up at this moment."""
PULL_S: Final = 120.0
ASK_S: Final = 30.0
NAME: Final = "sidestep:built-"
KEPT: Final = 3
PRODUCT: Final = (
    "Dockerfile", "docker", "pyproject.toml", "README.md", "LICENSE",
    "sidestep", "hatch_build.py", "runtime", "protocol", "robot", "firmware", "plant", "ground",
    "gateways", "vehicle_check", "study",
)  # fmt: skip
"""What the Dockerfile copies for the image of the product."""
SERVICES: Final = {"runtime": "router", "tests": "tests"}
"""A service that builds each target."""


class NoEngineError(Exception):
    """Containers cannot be tried on this machine; the message says why."""


def require_engine(within_s: float | None = None) -> None:
    """Wait, in CI, until engine and base image can be used; raise NoEngineError if they cannot."""
    patience_s = within_s if within_s is not None else SETUP_S if os.environ.get("CI") else 0.0
    found: list[str] = []

    def is_usable() -> bool:
        found[:] = [obstacle()]
        return not found[0]

    try:
        until(is_usable, within_s=patience_s, what="engine and base image", poll_s=1.0)
    except RuntimeError:
        raise NoEngineError(found[0]) from None


def obstacle() -> str:
    """Return why images cannot be built now; empty if they can."""
    base = base_image()
    for words in (("info",), ("compose", "version"), ("buildx", "version")):
        if why := failure(*words, within_s=ASK_S):
            return why
    if failure("image", "inspect", base, within_s=ASK_S) and (
        why := failure("pull", "--quiet", base, within_s=PULL_S)
    ):
        return f"no base image {base}: {why}"
    return ""


def failure(*words: str, within_s: float) -> str:
    """Return the last line of a failed call of docker; empty if it succeeds."""
    try:
        done = tried(["docker", *words], os.environ, within_s)
    except FileNotFoundError:
        return "no docker on this machine"
    except subprocess.TimeoutExpired:
        return f"docker {' '.join(words)}: no answer within {within_s:g} s"
    lines = done.said.strip().splitlines() or ["it fails"]
    return f"docker {' '.join(words)}: {lines[-1]}" if done.code else ""


def base_image() -> str:
    """Return the image that ours begins with."""
    found = re.search(r"^ARG BASE=(\S+)$", (ROOT / "Dockerfile").read_text(), re.M)
    assert found is not None
    return os.environ.get("BASE") or found[1]


def image(target: str = "runtime") -> str:
    """Return the name of an image of this tree, built if it is not there.

    The image of the tests has this name with `-tests` after it, as in docker-compose.yml. Raises
    AssertionError with the end of the output if the build fails.
    """
    base = docker("image", "inspect", "--format", "{{.Id}}", base_image()).strip()
    name = NAME + key_of(context(target), target, base)
    whole = name if target == "runtime" else f"{name}-{target}"
    with (cache() / "images.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if failure("image", "inspect", whole, within_s=ASK_S):
            Compose(name).does("build", SERVICES[target], within_s=BUILD_S)
            prune()
    return name


def context(target: str) -> set[Path]:
    """Return the files that an image is made of: the product's, or all that are tracked or new."""
    words = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    chosen: Iterable[str] = PRODUCT if target == "runtime" else ()
    listed = subprocess.run([*words, *chosen], cwd=ROOT, capture_output=True, check=False)
    if listed.returncode:  # no checkout
        roots = [ROOT / name for name in chosen or (".",)]
        found = {path for root in roots for path in (root, *root.rglob("*"))}
    else:
        found = {ROOT / name for name in listed.stdout.decode().split("\0") if name}
    return {path for path in found if path.is_file() and path.suffix != ".pyc"}


def prune() -> None:
    """Remove the names of older images; their layers remain while newer ones use them."""
    for suffix in ("", "-ros2", "-tests"):
        lines = docker("images", "--format", "{{.Repository}}:{{.Tag}}", "sidestep").splitlines()
        own = [line for line in lines if re.fullmatch(rf"{NAME}[0-9a-f]+{suffix}", line)]
        for old in own[KEPT:]:  # the newest is the first
            failure("rmi", old, within_s=ASK_S)  # refused while a container uses it


def main() -> int:
    """Build both images; return 1 with the reason if one cannot be built, or in CI none can."""
    try:
        require_engine()
        for target in SERVICES:
            print(f"{target}: {image(target)}")
    except NoEngineError as why:
        print(f"no image is built: {why}")
        return 1 if os.environ.get("CI") else 0
    except AssertionError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
