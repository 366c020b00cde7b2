"""Outcomes of trials for the tests of the falsifier."""

from dataclasses import replace

from protocol.outcome import Outcome

ARRIVED = Outcome(
    world="w",
    navigator="vgm",
    seed=0,
    noise="none",
    wall_s=0.1,
    outcome="reached",
    reason="",
    time_s=30.0,
    path_m=6.0,
    shortest_path_m=3.0,
    position_error_m=0.01,
    heading_error_rad=None,
    estimated_position_error_m=0.01,
    min_clearance_m=0.2,
    contacts=0,
    own_contacts=0,
    ticks=600,
    missed_ticks=0,
    digest="",
)
STUCK = replace(ARRIVED, outcome="stuck")
