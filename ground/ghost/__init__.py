"""What would another navigator have done? It is run from there, and its path laid beside."""

from ground.ghost.branch_point import BranchPoint, driving
from ground.ghost.ghost import Ghost
from ground.ghost.ghost_set import Ghosts
from ground.ghost.predicted_path import PredictedPath

__all__ = ["BranchPoint", "Ghost", "Ghosts", "PredictedPath", "driving"]
