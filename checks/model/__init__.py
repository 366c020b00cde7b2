"""Exhaustive exploration of the mode machine, the mission, the lease and manual control.

`world` drives the robot's real code without a bus. `events` lists the possible events, made from
the tables of the code. `explorer` visits every abstract state by breadth-first search, `invariants`
checks each transition, and `diagram` draws the result.
"""
