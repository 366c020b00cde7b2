"""`python -m tests.support.compose.images`: build the images once, so that later builds are short.

The layers stay in the engine's cache; the names are removed. Without an engine nothing is built,
and the tests with containers give the reason.
"""

import os
import sys
from uuid import uuid4

from tests.support.compose.compose import BUILD_S, Compose, docker, why_no_docker
from tests.support.until import until

ENGINE_S = 120.0 if os.environ.get("CI") else 0.0
"""In CI the engine is being set up meanwhile."""


def main() -> int:
    """Build the image of the product and that of its tests; 1 when a build fails."""
    try:
        until(lambda: not why_no_docker(), ENGINE_S, why_no_docker, poll_s=1.0)
    except AssertionError as error:
        print(error)
        return 0
    name = f"sidestep:built-{uuid4().hex[:8]}"
    built = True
    for service in ("router", "tests"):
        done = Compose(name).tries("build", service, within_s=BUILD_S)
        print(done.said[-2000:] if done.code else f"{service}: built")
        built = built and done.code == 0
    docker("rmi", "--force", name, f"{name}-tests")
    return 0 if built else 1


if __name__ == "__main__":
    sys.exit(main())
