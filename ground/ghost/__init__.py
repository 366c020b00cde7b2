"""Predict what another navigator would do: run it from an instant and return its path."""

from ground.ghost.branch_point import BranchPoint, driving
from ground.ghost.ghost import Ghost
from ground.ghost.ghost_set import Ghosts
from ground.ghost.predicted_path import PredictedPath

__all__ = ["BranchPoint", "Ghost", "Ghosts", "PredictedPath", "driving"]
