"""Define the sizes and colours of a figure: one for the screen, one for a column of a paper."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

INK: Final = "#1c1e21"
SOFT: Final = "#5d636b"
RULE: Final = "#d5d9de"
SOLID: Final = "#9aa1aa"
TRUE: Final = "#0054a6"
GOAL: Final = "#009e73"
WARM: Final = "#d55e00"
COOL: Final = "#3a9bd9"


@dataclass(frozen=True, slots=True)
class Style:
    """The size of a figure in inches, its fonts in points, and the weight of its lines.

    `one_column`: the parts are below each other, without a title, which the paper's caption has.
    """

    name: str
    width_in: float
    height_in: float
    font_pt: float
    line_pt: float
    dpi: int
    one_column: bool = False

    @property
    def settings(self) -> Mapping[str, Any]:
        """The settings of matplotlib; text stays text, and equal runs give equal files."""
        return {
            "font.size": self.font_pt,
            "axes.linewidth": self.line_pt / 2.0,
            "xtick.major.width": self.line_pt / 2.0,
            "ytick.major.width": self.line_pt / 2.0,
            "lines.linewidth": self.line_pt,
            "pdf.fonttype": 42,
            "svg.hashsalt": "sidestep",
        }


SCREEN: Final = Style("screen", 12.0, 7.5, font_pt=9.0, line_pt=1.4, dpi=120)
PAPER: Final = Style("paper", 3.5, 7.0, font_pt=7.0, line_pt=0.9, dpi=300, one_column=True)
STYLES: Final = MappingProxyType({style.name: style for style in (SCREEN, PAPER)})
