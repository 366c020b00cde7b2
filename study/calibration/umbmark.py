"""UMBmark (Borenstein and Feng, 1996): derive wheel errors from the return errors of squares.

The robot starts heading along x and drives the square with left turns (ccw, y > 0) or with right
turns (cw, y < 0). Unequal wheels bend the sides, a wrong track falsifies the corners. When driven
in both directions, one error shows in the difference of the two centres of gravity, the other in
their sum. Let a side be bent by b and a corner turned d too far, both to the left and small. Then
ccw returns by 2 L (d + b) in x and as much in -y, cw by 2 L (d - b) in x and in y.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, pi, sin

from robot.core.parameters import Params
from study.calibration.runs import CCW, CW, Array, SquareRun, errors_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Umbmark:
    """Centres of gravity of the return errors in metres, and the paper's ratios.

    `wheel_ratio` (E_d) and `track_ratio` (E_b) are true over assumed values; 1 is a correct robot.
    """

    cw_m: tuple[float, float]
    ccw_m: tuple[float, float]
    wheel_ratio: float
    track_ratio: float

    @property
    def largest_m(self) -> float:
        """E_max,syst: the larger distance of both centres of gravity."""
        return max(hypot(*self.cw_m), hypot(*self.ccw_m))


def umbmark(runs: Sequence[SquareRun], params: Params, side_m: float) -> Umbmark:
    """Evaluate squares with these parameters; runs of both directions are required."""
    cw = centre([run for run in runs if run.direction == CW], params)
    ccw = centre([run for run in runs if run.direction == CCW], params)
    left_rad, right_rad = (ccw[0] - ccw[1]) / (4.0 * side_m), (cw[0] + cw[1]) / (4.0 * side_m)
    bent_rad, corner_rad = 0.5 * (left_rad - right_rad), 0.5 * (left_rad + right_rad)
    return Umbmark(
        cw_m=(float(cw[0]), float(cw[1])),
        ccw_m=(float(ccw[0]), float(ccw[1])),
        wheel_ratio=wheel_ratio(bent_rad, side_m, params.track_m),
        track_ratio=0.5 * pi / (0.5 * pi + corner_rad),
    )


def wheel_ratio(bent_rad: float, side_m: float, track_m: float) -> float:
    """Return E_d from the bend of a side to the left, by the radii of both wheels' arcs."""
    if abs(bent_rad) < 1e-9:
        return 1.0
    radius_m = 0.5 * side_m / sin(0.5 * bent_rad)
    return (radius_m + 0.5 * track_m) / (radius_m - 0.5 * track_m)


def centre(runs: Sequence[SquareRun], params: Params) -> Array:
    """Return the mean error of the runs."""
    mean: Array = errors_of(runs, params).mean(axis=0)
    return mean
