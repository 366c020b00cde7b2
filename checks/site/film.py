"""Film the screen of real drives: `make pictures`, or `python -m checks.site.film NAME`.

`sidestep up` runs in a terminal of tmux, whose cells are read once a second. A film is an animated
SVG without a script, so that GitHub shows it: each word of the screen is drawn once, and visible in
the frames that had it. A still is the last frame.
"""

import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from rich.cells import cell_len
from rich.color import ColorType
from rich.style import Style
from rich.text import Text

from checks.harness.until import until
from tests.support.pages import File, steps_of
from tests.support.screens import Tmux

DOCS: Final = Path(__file__).resolve().parents[2] / "docs"
FOLDER: Final = DOCS / "pictures"
SECONDS: Final = 1.0
"""From frame to frame of the drive."""
FASTER: Final = 4.0
PAUSE_S: Final = 4.0
"""For which a film shows its last frame."""
MOST_S: Final = 300.0
CELL: Final = (8.4, 18)
BASE: Final = 13
EDGE: Final = 12
FACE: Final = "ui-monospace,SFMono-Regular,Menlo,Consolas,'DejaVu Sans Mono',monospace"
GROUND: Final = "#10151c"
INK: Final = "#d5dce4"


class Scene(NamedTuple):
    """What is filmed: a shell command, what is typed, and the words that end it.

    `typed` are pairs of words to wait for, and the text to type then. The files that `page` asks
    its reader to save are there. Of a scene that does not move only the end is kept.
    """

    words: str
    end: str
    typed: tuple[tuple[str, str], ...] = ()
    page: str = ""
    moves: bool = False
    size: tuple[int, int] = (110, 32)


READY: Final = "parameters read"
ENTER: Final = "\r"
SCENES: Final = {
    "screen": Scene("sidestep up --no-record --world u_trap", "REACHED", moves=True),
    "first-drive": Scene("sidestep up --no-record", "REACHED", moves=True),
    "mission": Scene(
        "sidestep up --no-record --no-goal",
        "DRIVING",
        (
            (READY, f":mission upload tour.toml{ENTER}"),
            ("2 waypoints", f":mission start{ENTER}"),
        ),
        page="tutorial/mission.md",
    ),
    "recording": Scene(
        "sidestep up --headless --world wall --navigator vgm --speed max --record runs"
        " && sidestep replay runs/*.mcap",
        "AVOIDING",
        (("p Play", "p"),),
    ),
    "own-world": Scene(
        "sidestep up --no-record --world door.toml", "REACHED", page="tutorial/own-world.md"
    ),
    "one-tick": Scene("sidestep up --no-record --world disc --navigator vgm", "AVOIDING"),
    "several-robots": Scene("sidestep up --no-record --robots 3 --world forest_sparse", "AVOIDING"),
    "people": Scene("sidestep up --no-record --world moving", "AVOIDING"),
}

Run: TypeAlias = tuple[str, Style]
Row: TypeAlias = tuple[Run, ...]
"""One row of the terminal, as texts of one style each."""


def rows_of(coloured: str) -> list[Row]:
    """Return the rows of a terminal with escape sequences, as tmux captures them."""
    return [row_of(Text.from_ansi(line)) for line in coloured.split("\n")]


def row_of(text: Text) -> Row:
    """Return the runs of a line; blanks without a background are left out by `drawn`."""
    plain, styles = text.plain, [Style()] * len(text.plain)
    for span in text.spans:
        style = span.style if isinstance(span.style, Style) else Style.parse(span.style)
        for i in range(span.start, min(span.end, len(styles))):
            styles[i] += style
    pairs = groupby(zip(plain, styles, strict=True), key=lambda pair: pair[1])
    return tuple(("".join(letter for letter, _ in run), style) for style, run in pairs)


def elements_of(frame: Sequence[Row], classes: dict[str, str]) -> Iterator[tuple[bool, str]]:
    """Yield the SVG elements of a frame, each with whether it is a text.

    Each word is placed on its own, and letters of other kinds than ASCII apart from those: they may
    be as wide as another font likes. `classes` receives the styles with their names.
    """
    for number, row in enumerate(frame):
        column, y = 0, EDGE + number * CELL[1]
        for text, style in row:
            fore, back = colours(style)
            if back is not None:
                box = f'width="{cell_len(text) * CELL[0]:.1f}" height="{CELL[1]}" fill="{back}"'
                yield False, f'<rect x="{place(column)}" y="{y}" {box}/>'
            rule = f"fill:{fore}" + (";font-weight:bold" if style.bold else "")
            name = classes.setdefault(rule, f"c{len(classes)}")
            for offset, word in words_of(text):
                length = f"{cell_len(word) * CELL[0]:.1f}"
                x, base = place(column + offset), y + BASE
                yield (
                    True,
                    f'<text class="{name}" x="{x}" y="{base}" textLength="{length}">'
                    f"{escape(word)}</text>",
                )
            column += cell_len(text)


def place(column: int) -> str:
    """Return the x of a column of the terminal."""
    return f"{EDGE + column * CELL[0]:.1f}"


def words_of(text: str) -> Iterator[tuple[int, str]]:
    """Yield the words of a text with their columns, letters of ASCII apart from others."""
    column = 0
    for kind, letters in groupby(text, key=lambda letter: (letter == " ", letter.isascii())):
        word = "".join(letters)
        if not kind[0]:
            yield column, word
        column += cell_len(word)


def colours(style: Style) -> tuple[str, str | None]:
    """Return the colour of the letters, and that of their ground if it is not the usual one."""
    fore, back = (
        None if one is None or one.type is ColorType.DEFAULT else one.get_truecolor().hex
        for one in (style.color, style.bgcolor)
    )
    if style.reverse:
        return back or GROUND, fore or INK
    return fore or INK, back


def film(frames: Sequence[Sequence[Row]], seconds: float, title: str) -> str:
    """Return an SVG that shows the frames one after the other, and a single one as a still.

    Each element is written once, with those that are seen in the same frames.
    """
    times = [i * seconds / FASTER for i in range(len(frames))]
    columns = max(sum(cell_len(text) for text, _ in row) for frame in frames for row in frame)
    width = 2 * EDGE + columns * CELL[0]
    height = 2 * EDGE + max(map(len, frames)) * CELL[1]
    classes: dict[str, str] = {}
    seen: dict[tuple[bool, str], list[int]] = {}
    for number, frame in enumerate(frames):
        for found in elements_of(frame, classes):
            seen.setdefault(found, []).append(number)
    together: dict[tuple[bool, tuple[int, ...]], list[str]] = {}
    for (is_text, element), numbers in seen.items():
        together.setdefault((is_text, tuple(numbers)), []).append(element)
    rules = "".join(f".{name}{{{rule}}}" for rule, name in classes.items())
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}">',
        f"<title>{escape(title)}</title>",
        f"<style>text{{font:14px {FACE};white-space:pre}}{rules}</style>",
        f'<rect width="100%" height="100%" rx="8" fill="{GROUND}"/>',
    ]
    for (_, visible), elements in sorted(together.items(), key=lambda item: item[0][0]):
        start, animation = shown_in(visible, times)
        parts.append(f"<g{start}>{animation}{''.join(elements)}</g>")
    return "\n".join([*parts, "</svg>\n"])


def shown_in(numbers: Sequence[int], times: Sequence[float]) -> tuple[str, str]:
    """Return attribute and animation of what is seen in these frames only.

    A program that plays no animation shows the last frame.
    """
    visible = [i in numbers for i in range(len(times))]
    if all(visible):
        return "", ""
    changes = [i for i, one in enumerate(visible) if i == 0 or one != visible[i - 1]]
    whole_s = times[-1] + PAUSE_S
    values = ";".join("visible" if visible[i] else "hidden" for i in changes)
    shares = ";".join(f"{times[i] / whole_s:.4g}" for i in changes)
    animation = (
        f'<animate attributeName="visibility" values="{values}" keyTimes="{shares}" '
        f'dur="{whole_s:g}s" calcMode="discrete" repeatCount="indefinite"/>'
    )
    return ("" if visible[-1] else ' visibility="hidden"'), animation


def frames_of(scene: Scene) -> list[list[Row]]:
    """Run a scene in a terminal and return its frames."""
    frames: list[list[Row]] = []
    programs = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    looks = {"COLORTERM": "truecolor", "TERM": "xterm-256color", "TZ": "UTC", "PATH": programs}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for step in steps_of(DOCS / scene.page) if scene.page else ():
            if isinstance(step, File):
                (folder / step.name).write_text(step.text, encoding="utf-8")
        with Tmux(folder, ["sh", "-c", scene.words], scene.size, looks) as terminal:
            terminal.shows("▶ robot", within_s=MOST_S)
            for shown, text in scene.typed:
                terminal.shows(shown, within_s=MOST_S)
                terminal.type(text)

            def is_over() -> bool:
                coloured = terminal.coloured.rstrip("\n")
                frames.append(rows_of(coloured))
                return scene.end in coloured

            until(is_over, what=scene.end, within_s=MOST_S, poll_s=SECONDS)
            terminal.press("C-q", "C-q")
            terminal.ends()
    return frames


def main() -> int:
    """Film all scenes."""
    for name in sys.argv[1:] or SCENES:
        scene = SCENES[name]
        frames = frames_of(scene)
        chosen = frames if scene.moves else frames[-1:]
        path = FOLDER / f"{name}.svg"
        path.write_text(film(chosen, SECONDS, scene.words), encoding="utf-8")
        size_kb = path.stat().st_size / 1000
        print(f"{path}: {len(chosen)} frames, {size_kb:.0f} kB", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
