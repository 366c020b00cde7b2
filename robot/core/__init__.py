"""The control core, which also runs under MicroPython; it imports `math`, `typing`,
`runtime.elementary` and itself.
"""
