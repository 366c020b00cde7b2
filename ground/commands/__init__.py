"""Frozen values, one for each operation of an operator; `perform(session)` carries it out.

The constructor checks the values: UserError names one that is out of range. `moves` is True if an
operation can move the robot or change how it moves.
"""
