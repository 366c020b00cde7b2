"""The image of this tree; where there is no engine these tests are skipped, and fail in CI."""

import os

import pytest

from tests.support import images


@pytest.fixture(scope="session")
def image() -> str:
    """Return the name of the image of this tree, built if it is not there."""
    try:
        images.require_engine()
    except images.NoEngineError as why:
        if os.environ.get("CI"):
            pytest.fail(str(why))
        pytest.skip(str(why))
    return images.image()
