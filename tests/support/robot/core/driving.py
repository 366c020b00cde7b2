"""A core in a test: senses that are there, unless a test takes them away, and wheels that obey."""

from robot.core import brain, modes, states
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Goal, Inputs, Outputs, Scan, Wheels

AHEAD = Goal(3.0, 0.0, None, 0.05, 0.05)
OPEN_SPACE = Scan((0,) * 8, (25, 0) * 4, 0xFF, 0)


class Driven:
    """Steps the brain tick by tick; wheels follow the previous command (unless `jammed`)."""

    def __init__(self, params: Params = DEFAULTS) -> None:
        self.params = params
        self.state = brain.State(params)
        self.machine = self.state.machine
        self.outputs = Outputs(0, 0, 0, self.state.twist, None)
        self.now_ms = 0
        self.left = self.right = 0.0
        self.bumper = 0
        self.scan: Scan | None = OPEN_SPACE
        self.has_wheels = True
        self.operator_age_ms: int | None = 0
        self.jammed = False

    def forward(self, seconds: float) -> "Driven":
        for _ in range(round(seconds * 20)):
            self.tick()
        return self

    def tick(self) -> Outputs:
        wheels = Wheels(round(self.left), round(self.right), self.bumper, self.now_ms)
        inputs = Inputs(
            self.now_ms, wheels if self.has_wheels else None, self.scan, self.operator_age_ms
        )
        self.state, self.outputs = brain.step(self.state, inputs, self.params)
        if not self.jammed:
            per_tick = self.params.wheel_radius_m * 5e-5 / self.params.m_per_tick
            self.left += self.outputs.left_mrad_s * per_tick
            self.right += self.outputs.right_mrad_s * per_tick
        self.now_ms += 50
        return self.outputs

    @property
    def stands(self) -> bool:
        return self.outputs.left_mrad_s == 0 and self.outputs.right_mrad_s == 0

    def goto(self, goal: Goal = AHEAD, mode: int = states.AUTO) -> int:
        return modes.goto(self.machine, goal, mode, self.now_ms)


def armed(params: Params = DEFAULTS) -> Driven:
    """Booted, with senses, armed, standing."""
    driven = Driven(params)
    driven.tick()
    assert modes.arm(driven.machine) == 0
    return driven


def driving(mode: int = states.AUTO, params: Params = DEFAULTS) -> Driven:
    """Half a second on its way to a goal three metres ahead."""
    driven = armed(params)
    assert driven.goto(mode=mode) == 0
    driven.forward(0.5)
    assert not driven.stands
    return driven
