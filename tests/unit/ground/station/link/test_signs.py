"""One look at all the signs: a robot that is silent alone, or with everybody else."""

import pytest

from ground.station.link.loss import LossInputs, LossKind, judge

MS = 1_000_000


@pytest.mark.parametrize(
    ("others_ms", "kind"),
    [
        (20, LossKind.PROCESS_DEAD),  # the plant is heard, so it is not the link
        (250, LossKind.PROCESS_DEAD),
        (480, None),  # it fell silent with the robot: a cable may have been cut
        (900, None),
        (None, None),
    ],
)
def test_a_robot_is_called_dead_when_others_are_heard_since(
    others_ms: int | None, kind: LossKind | None
) -> None:
    others_ns = None if others_ms is None else others_ms * MS
    signs = LossInputs(10_000 * MS, gone_ns=100 * MS, beat_ns=500 * MS, others_ns=others_ns)
    assert judge(signs) is kind


def test_without_others_it_is_told_once_the_link_is_known_to_stand() -> None:
    signs = LossInputs(10_000 * MS, gone_ns=600 * MS, beat_ns=700 * MS)
    assert judge(signs) is None
    assert judge(signs._replace(hub_ns=100 * MS)) is LossKind.PROCESS_DEAD
