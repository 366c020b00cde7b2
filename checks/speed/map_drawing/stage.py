"""An app that paints frame after frame of one widget, on a driver that counts its output."""

import asyncio
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from statistics import median
from time import thread_time
from typing import Any, Final

from rich.console import Console
from textual.app import App, ComposeResult
from textual.drivers.headless_driver import HeadlessDriver
from textual.pilot import Pilot
from textual.widget import Widget

PATIENCE_S: Final = 120.0
WARM_UP: Final = 5


@dataclass(slots=True)
class FrameCost:
    """CPU time and output of each frame."""

    cpu_ms: list[float] = field(default_factory=list)
    written_kb: list[float] = field(default_factory=list)

    @property
    def median_ms(self) -> float:
        """Median CPU time of a frame."""
        return median(self.cpu_ms)

    @property
    def median_kb(self) -> float:
        """Median output of a frame."""
        return median(self.written_kb)


class CountingDriver(HeadlessDriver):
    """Accept output at full speed and count it."""

    def __init__(self, app: "BenchmarkApp", **options: Any) -> None:
        super().__init__(app, **options)
        app.terminal = self
        self.written = 0
        self.painted = asyncio.Event()

    @property
    def is_headless(self) -> bool:
        """False, as Textual would not write to a headless driver."""
        return False

    def write(self, data: str) -> None:
        """Count output."""
        self.written += len(data.encode())
        self.painted.set()


class BenchmarkApp(App[None]):
    """An app with one widget on the whole screen."""

    terminal: CountingDriver

    def __init__(self, widget: Widget) -> None:
        super().__init__(driver_class=CountingDriver)
        file = self.console.file
        self.console = Console(color_system="truecolor", file=file, force_terminal=True)
        self.widget = widget

    def compose(self) -> ComposeResult:
        """Return the widget."""
        yield self.widget


def measure_frames(
    widget: Widget, frames: Iterable[Callable[[], None]], size: tuple[int, int]
) -> FrameCost:
    """Return the CPU time of the thread from paint to paint, Textual's share included."""
    stage, cost = BenchmarkApp(widget), FrameCost()

    async def play(_: Pilot[object]) -> None:
        for number, frame in enumerate(frames):
            stage.terminal.painted.clear()
            begun_s, stage.terminal.written = thread_time(), 0
            frame()
            await stage.terminal.painted.wait()
            if number >= WARM_UP:
                cost.cpu_ms.append((thread_time() - begun_s) * 1e3)
                cost.written_kb.append(stage.terminal.written / 1e3)
        stage.exit()

    async def play_in_time(pilot: Pilot[object]) -> None:
        await asyncio.wait_for(play(pilot), PATIENCE_S)

    stage.run(size=size, auto_pilot=play_in_time)
    return cost
