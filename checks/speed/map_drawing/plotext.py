"""Draw the lines of a recorded canvas with textual-plotext, used as documented."""

from collections.abc import Sequence

from textual_plotext import PlotextPlot

from ground.map.canvas import Dot

Lines = Sequence[tuple[tuple[int, int, int], Sequence[Dot]]]
"""Colour of each polyline, and its points in dots from the upper left corner."""


class PlotextMap(PlotextPlot):
    """A plot in Braille without axes, which fills the widget."""

    def show(self, lines: Lines) -> None:
        """Draw these lines."""
        plot, (wide, high) = self.plt, (2 * self.size.width, 4 * self.size.height)
        plot.clear_data()
        plot.frame(False)
        plot.xticks([])
        plot.yticks([])
        plot.xlim(0, wide - 1)
        plot.ylim(0, high - 1)
        for colour, dots in lines:
            xs = [x for x, _ in dots]
            ys = [high - 1 - y for _, y in dots]
            plot.plot(xs, ys, marker="braille", color=colour)
        self.refresh()
