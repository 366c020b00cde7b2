"""An observer that looks for contradictions: what programs say, compared with what was.

Persons and their programs drive one simulated robot. All that the programs say is noted, and so is
the truth: the robot's own state, the plant's pose, the requests that arrived, and which messages
reached whom. After the run each word is compared with the truth by rules of the observer's own.
"""
