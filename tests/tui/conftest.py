"""`--update-screens` writes the pictures of the screens anew."""

import pytest


@pytest.fixture
def update_screens(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--update-screens"))
