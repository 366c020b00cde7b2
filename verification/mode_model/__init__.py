"""Exhaustive exploration of the mode machine, the mission, the lease and the dead man's handle.

`world` drives the robot's real code without a bus. `events` lists what may happen, made from the
tables of the code. `explorer` visits every abstract state by breadth-first search, `invariants`
judges each transition, and `diagram` draws what was found.
"""
