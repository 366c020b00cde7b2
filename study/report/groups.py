"""Groups of worlds: the corpus, and the families that the report judges apart from it."""

from typing import Final

import numpy as np

from plant.corpus import ADVERSARIAL_FAMILIES, CROWD_FAMILIES
from study.report.trials import Flags, Trials

CORPUS: Final = "corpus"
GRIDS: Final = "grid maps"
ADVERSARIAL: Final = "adversarial worlds"
THIN: Final = "thin walls"
CROWDS: Final = "crowds"

PLANNER: Final = "oracle_grid"
"""The navigator with unlimited memory and the same senses: a comparison, not a competitor."""

GRID_PREFIXES: Final = ("moving_ai", "movingai", "grid")
"""Prefixes of the families in Moving AI's format."""

THIN_PREFIX: Final = "thin"
NOTES: Final = {
    GRIDS: "Maps in the format of Moving AI's benchmark, in cells of a robot's size.",
    ADVERSARIAL: (
        "**Adversarial**: the families of `sidestep falsify`, made to fool a navigator. Their "
        "rates do not describe ordinary places and are in no other figure of this report."
    ),
    THIN: "Walls of 2 to 10 mm, which send few echoes from their ends.",
    CROWDS: "People whose paths cross, so that not every contact can be avoided.",
}
"""What the reader must know about each group that is not the corpus."""


def group_of(family: str) -> str:
    """Return the group of a family; a family without a group of its own is of the corpus."""
    if family in ADVERSARIAL_FAMILIES:
        return ADVERSARIAL
    if family.startswith(GRID_PREFIXES):
        return GRIDS
    if family.startswith(THIN_PREFIX):
        return THIN
    return CROWDS if family in CROWD_FAMILIES else CORPUS


def in_group(trials: Trials, *groups: str) -> Trials:
    """Return the trials in worlds of these groups."""
    return trials.where(_flags(trials, groups))


def main_of(trials: Trials) -> Trials:
    """Return the trials of the corpus; all trials of a study that has none of them."""
    corpus = in_group(trials, CORPUS)
    return corpus if len(corpus) else trials


def apart_of(trials: Trials) -> dict[str, Trials]:
    """Return the trials of each other group that the study has beside the corpus."""
    if not len(in_group(trials, CORPUS)):
        return {}
    found = {group: in_group(trials, group) for group in NOTES}
    return {group: some for group, some in found.items() if len(some)}


def _flags(trials: Trials, groups: tuple[str, ...]) -> Flags:
    families = trials.texts("family").tolist()
    return np.array([group_of(family) in groups for family in families], dtype=np.bool_)
