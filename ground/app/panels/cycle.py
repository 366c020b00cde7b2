"""Show the cost of the control cycle and of its stages, for the Links screen."""

from typing import Final

from ground.app.panels.aged import aged, live, role_of
from ground.app.widgets.bars import bar
from ground.app.widgets.rows import Row, Span, head, row
from ground.client.telemetry import AgedMessage
from protocol.wire.messages import CycleReport

STAGES: Final = ("read", "odometry", "navigate", "guard", "write")
BAR: Final = 8


def cycle_rows(seen: AgedMessage, report: CycleReport | None) -> list[Row]:
    """Return the most expensive control cycle of the last second, and its stages.

    The cost is compared with the budget; stages are in microseconds.
    """
    if live(seen) is None or report is None:
        return [row(head(" cycle   "), aged(seen, lambda _: ""))]
    spent, budget = sum(report.stage_us), report.budget_us
    over = "danger" if spent > budget else "mission"
    gauge = Span(bar(spent / budget if budget else 1.0, BAR), role_of(seen, over))
    marks = Span(" over budget" if spent > budget else "", "danger")
    stages = zip(STAGES, report.stage_us, strict=True)
    shares = (piece for name, us in stages for piece in (head(f"{name} "), Span(f"{us}  ")))
    return [
        row(
            head(" cycle   "), gauge, f" {spent} of {budget} us", marks,
            f", {report.late_us / 1000:.2f} ms late, {report.missed} missed",
        ),
        row(head("   of it "), *shares),
    ]  # fmt: skip
