"""Test that layers which are kept from frame to frame look as if all were drawn anew."""

from collections.abc import Collection
from dataclasses import replace

import pytest

from ground.map import drawing
from ground.map.canvas import Canvas
from ground.map.drawing import KeptLayers, draw, draw_moving
from ground.map.scene import LAYERS, MapScene
from ground.map.view import View
from tests.support.ground.map.rooms import EVERYTHING

VIEW = View(60, 20, 3.0, 2.0, 0.05)
DRIVEN = tuple((0.1 * step, 2.0 + 0.02 * step) for step in range(40))


def drawn(layers: KeptLayers, scene: MapScene, shown: Collection[str] = LAYERS) -> Canvas:
    canvas = layers.below(scene, VIEW, shown, Canvas(60, 20))
    draw_moving(scene, VIEW, canvas, shown)
    return canvas


def drawn_anew(scene: MapScene, shown: Collection[str] = LAYERS) -> Canvas:
    canvas = Canvas(60, 20)
    draw(scene, VIEW, canvas, shown)
    return canvas


def test_kept_layers_equal_a_new_drawing() -> None:
    layers = KeptLayers()
    without_trail = frozenset(LAYERS) - {"trail"}
    scenes = [replace(EVERYTHING, trail=DRIVEN[:count]) for count in (0, 1, 10, 11, 40, 40, 5)]
    scenes += [
        replace(EVERYTHING, trail=DRIVEN[::2]),
        replace(EVERYTHING, trail=DRIVEN, seen=((1.0, 1.0),)),
        replace(EVERYTHING, trail=DRIVEN, others=()),
        replace(EVERYTHING, trail=DRIVEN, obstacles=()),
    ]
    for scene in scenes:
        assert drawn(layers, scene).changed_rows(drawn_anew(scene)) == []
    for shown in (without_trail, LAYERS):
        found = drawn(layers, scenes[-1], shown)
        assert found.changed_rows(drawn_anew(scenes[-1], shown)) == []


def test_only_the_new_end_of_a_trail_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    starts: list[int | None] = []

    def note(*_: object, drawn: int | None = None) -> None:
        starts.append(drawn)

    monkeypatch.setattr(drawing, "draw_traces", note)
    layers = KeptLayers()
    for count in (0, 0, 5, 5, 9, 10):
        drawn(layers, replace(EVERYTHING, trail=DRIVEN[:count]))
    drawn(layers, replace(EVERYTHING, trail=DRIVEN[1:11]))
    assert starts == [None, 0, 5, 9, None]
