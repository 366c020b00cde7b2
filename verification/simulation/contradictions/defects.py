"""Fixed defects of words, which can be put back to check that the observer finds them."""

from typing import Final

from verification.simulation.defects import Defect

DEFECTS: Final[dict[str, Defect]] = {}
