"""Define fixtures for the screens; `--update-screens` writes their pictures again."""

from typing import Any

import pytest

from tests.support.app import FAULTS, WORLD, hasten


@pytest.fixture(autouse=True)
def quick_textual(monkeypatch: pytest.MonkeyPatch) -> None:
    hasten(monkeypatch)


@pytest.fixture
def update_screens(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--update-screens"))


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the plant and the outcomes of the study by fixed answers."""

    def ask(*words: str) -> dict[str, Any]:
        if words == ("list",):
            texts = {"box": "One box across the straight way.", "wall": "A wall, and a walker."}
            return {"worlds": [{"name": name, "says": text} for name, text in texts.items()]}
        return FAULTS if words == ("faults",) else {**WORLD, "name": words[1]}

    monkeypatch.setattr("ground.app.screens.worlds.query_worlds", ask)
    monkeypatch.setattr("ground.app.screens.faults.query_worlds", ask)
    reached = {"wall": {"bug left": 0, "vgm": 7, "vgm_memory": 10}}
    monkeypatch.setattr("ground.app.screens.worlds.read_reached_counts", lambda: reached)
