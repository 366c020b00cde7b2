"""Explain the decision of one tick in plain words, and list the instants that decided a run."""

from ground.explain.explanation import Explanation, explain
from ground.explain.reason_text import Turned, Why, explained
from ground.explain.turning import TurningPoint, turning_point

__all__ = [
    "Explanation",
    "Turned",
    "TurningPoint",
    "Why",
    "explain",
    "explained",
    "turning_point",
]
