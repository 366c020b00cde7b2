"""Verbs that observe a robot, record it, or look at a recording."""
