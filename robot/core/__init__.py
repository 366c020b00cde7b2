"""The control core, which also runs under MicroPython.

It imports `math`, `typing`, `runtime.elementary` and itself.
"""
