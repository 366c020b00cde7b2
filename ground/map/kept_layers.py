"""Cache the layers below the robot, and draw only changed layers again."""

from collections.abc import Collection, Sequence

from ground.map.canvas import Canvas
from ground.map.drawing import draw_static, draw_traces, static_parts, trace_parts
from ground.map.scene import MapScene
from ground.map.view import Point, View


class KeptLayers:
    """A canvas with the static layers, and one with the traces above them."""

    def __init__(self) -> None:
        self._static = self._traced = Canvas(0, 0)
        self._static_key: tuple[object, ...] = ()
        self._trace_key: tuple[object, ...] = ()
        self._trail: Sequence[Point] = ()

    def below(self, scene: MapScene, view: View, layers: Collection[str], blank: Canvas) -> Canvas:
        """Return a new canvas with the layers of a scene below the moving ones.

        `blank` is an empty canvas of the form that is wanted.
        """
        key = (view, layers, blank.ascii_only, blank.is_mono, *static_parts(scene))
        is_same = key == self._static_key
        if not is_same:
            self._static_key, self._static = key, blank
            draw_static(scene, view, blank, layers)
        self._trace(scene, view, layers, is_same=is_same)
        return self._traced.copy()

    def _trace(
        self, scene: MapScene, view: View, layers: Collection[str], *, is_same: bool
    ) -> None:
        """Draw the traces; if only the trail has grown, draw only its new part."""
        key, trail, drawn = trace_parts(scene), scene.trail, len(self._trail)
        if is_same and key == self._trace_key and trail[:drawn] == self._trail:
            if len(trail) > drawn:
                draw_traces(scene, view, self._traced, layers, drawn=drawn)
        else:
            self._traced = self._static.copy()
            draw_traces(scene, view, self._traced, layers)
        self._trace_key, self._trail = key, trail
