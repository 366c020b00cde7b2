"""Scores of a single trial that other benchmarks publish."""

from typing import Final

FASTEST, SLOWEST = 2.0, 8.0
"""Limits of the time in optimal times; a robot that needs twice the optimal has the full score."""

FULL_SCORE: Final = 1.0 / FASTEST


def published_score(
    arrived: bool, time_s: float, shortest_path_m: float | None, speed_m_s: float
) -> float | None:
    """Return the score of the BARN challenge, at most `FULL_SCORE`; None without a way to the goal.

    It is success x optimal time / clip(time, 2 x optimal time, 8 x optimal time). The optimal time
    is that of the shortest path at the robot's own top speed (the challenge takes 2 m/s).
    """
    if shortest_path_m is None:
        return None
    if not arrived:
        return 0.0
    optimal_s = shortest_path_m / speed_m_s
    if optimal_s == 0.0:
        return FULL_SCORE
    return 1.0 / min(max(time_s / optimal_s, FASTEST), SLOWEST)


def spl(arrived: bool, path_m: float, shortest_path_m: float | None) -> float | None:
    """Return success weighted by path length (Anderson et al. 2018), at most 1.

    It is success x shortest path / max(path, shortest path); None without a way to the goal.
    """
    if shortest_path_m is None:
        return None
    if not arrived:
        return 0.0
    longer_m = max(path_m, shortest_path_m)
    return shortest_path_m / longer_m if longer_m > 0.0 else 1.0
