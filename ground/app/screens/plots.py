"""Plots: speed, way to go, nearest echo, cost and uncertainty over the last minutes."""

from collections.abc import Mapping
from functools import partial
from typing import Final

from textual.app import ComposeResult
from textual.containers import Grid

from ground.app.input.key_table import Layer
from ground.app.panels.plots import plot_rows
from ground.app.playback.app_interface import Deck
from ground.app.screens.sheet import Action, Sheet
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import faint, row
from ground.app.widgets.sparklines import FIGURES, Figure

WINDOWS_S: Final = (15.0, 30.0, 60.0, 120.0, 300.0, 600.0)
DRAWN_HZ: Final = 4.0


class PlotsScreen(Sheet):
    key_layer = Layer.PLOTS

    def __init__(self, deck: Deck) -> None:
        super().__init__(deck)
        self._window = 2
        self._drawn: tuple[object, ...] = ()

    def middle(self) -> ComposeResult:
        yield Lines(id="heading")
        with Grid(id="plots"):
            for figure in FIGURES:
                yield Lines(id=f"plot-{figure.series.replace('_', '-')}")

    def draw(self) -> None:
        """A few times a second: all of it moves, and nobody reads faster."""
        station, window_s = self.deck.station, WINDOWS_S[self._window]
        panels = [(figure, self.panel(figure)) for figure in FIGURES]
        moment = int(station.time_s * DRAWN_HZ)
        state = (moment, self._window, [panel.size for _, panel in panels])
        if state == self._drawn:
            return
        self._drawn = state
        self.lines("heading").show([row(faint(f" the last {window_s:g} s"))])
        for figure, panel in panels:
            panel.show(plot_rows(station, figure, panel.size, window_s, self.deck.ascii_only))

    def panel(self, figure: Figure) -> Lines:
        return self.lines(f"plot-{figure.series.replace('_', '-')}")

    def actions(self) -> Mapping[str, Action]:
        return {
            **super().actions(),
            "plot-shorter": partial(self.widen, -1),
            "plot-longer": partial(self.widen, 1),
        }

    def widen(self, steps: int) -> None:
        self._window = max(0, min(len(WINDOWS_S) - 1, self._window + steps))
