"""`--update-screens` writes the pictures of the screens anew."""

from typing import Any

import pytest

from tests.support.tui.plant_side import FAULTS, WORLD


@pytest.fixture
def update_screens(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--update-screens"))


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plant's side is not asked, and the study has found this."""

    def ask(*words: str) -> dict[str, Any]:
        if words == ("list",):
            says = {"box": "One box across the straight way.", "wall": "A wall, and a walker."}
            return {"worlds": [{"name": name, "says": what} for name, what in says.items()]}
        return FAULTS if words == ("faults",) else {**WORLD, "name": words[1]}

    monkeypatch.setattr("ground.app.screens.worlds.query_worlds", ask)
    monkeypatch.setattr("ground.app.screens.faults.query_worlds", ask)
    reached = {"wall": {"bug left": 0, "vgm": 7, "vgm_memory": 10}}
    monkeypatch.setattr("ground.app.screens.worlds.read_reached_counts", lambda: reached)
