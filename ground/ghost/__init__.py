"""What would another navigator have done? It is run from there, and its path laid beside."""

from ground.ghost.course import Course
from ground.ghost.ghost import Ghost
from ground.ghost.ghosts import Ghosts
from ground.ghost.instant import Instant, driving

__all__ = ["Course", "Ghost", "Ghosts", "Instant", "driving"]
