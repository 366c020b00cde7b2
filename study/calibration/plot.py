"""Plot the return errors of both directions before and after, with their centres of gravity."""

from pathlib import Path

from study.calibration.result import CalibrationResult
from study.calibration.runs import CCW, CW, errors_of


def write(path: Path, result: CalibrationResult) -> None:
    """Write an SVG or PNG file; raise OSError, or ValueError for another suffix."""
    from matplotlib.figure import Figure  # slow import, needed only here

    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    was, now = figure.subplots(1, 2)
    panels = (
        (was, "before", result.first, result.before),
        (now, "after", result.second, result.after),
    )
    for axes, title, runs, params in panels:
        for direction, mark, colour in ((CW, "o", "tab:blue"), (CCW, "s", "tab:orange")):
            errors = errors_of([run for run in runs if run.direction == direction], params)
            axes.scatter(
                errors[:, 0], errors[:, 1], s=14, marker=mark, color=colour, label=direction
            )
            centre = errors.mean(axis=0)
            axes.scatter(centre[0], centre[1], s=160, marker="+", color=colour, linewidths=2.5)
        axes.axhline(0.0, color="0.7", linewidth=0.8)
        axes.axvline(0.0, color="0.7", linewidth=0.8)
        axes.set(title=title, xlabel="return error x, m", ylabel="y, m")
        axes.set_aspect("equal", adjustable="box")
    was.legend(title="direction (+ centre)")
    most = max(
        float(abs(errors_of(result.first, result.before)[:, :2]).max()),
        float(abs(errors_of(result.second, result.after)[:, :2]).max()),
    )
    for axes in (was, now):
        axes.set_xlim(-1.1 * most, 1.1 * most)
        axes.set_ylim(-1.1 * most, 1.1 * most)
    figure.suptitle(result.source, fontsize=10)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
