"""`--update-screens` writes the pictures of the screens anew."""

from typing import Any

import pytest

from tests.tui.plant_side import FAULTS, WORLD


@pytest.fixture
def update_screens(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--update-screens"))


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    def ask(*words: str) -> dict[str, Any]:
        if words == ("list",):
            return {"worlds": [{"name": name, "says": f"{name}."} for name in ("box", "wall")]}
        return FAULTS if words == ("faults",) else {**WORLD, "name": words[1]}

    monkeypatch.setattr("ground.app.screens.worlds.ask_worlds", ask)
    monkeypatch.setattr("ground.app.screens.faults.ask_worlds", ask)
