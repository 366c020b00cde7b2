"""Draw a scene, given in metres, through a view onto a canvas of characters.

No terminal is needed.
"""
