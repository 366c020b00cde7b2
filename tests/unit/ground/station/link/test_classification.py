"""Classify a robot that is silent alone, or together with other processes."""

from ground.station.link.loss import LossInputs, LossKind, classify
from tests.support.each import each

MS = 1_000_000


@each(
    ("others_ms", "kind"),
    [
        (20, LossKind.PROCESS_DEAD),  # the plant is received, so the link is intact
        (250, LossKind.PROCESS_DEAD),
        (480, None),  # both became silent: a cable may have been cut
        (900, None),
        (None, None),
    ],
)
def test_robot_is_dead_if_others_were_received_since(
    others_ms: int | None, kind: LossKind | None
) -> None:
    others_ns = None if others_ms is None else others_ms * MS
    inputs = LossInputs(10_000 * MS, gone_ns=100 * MS, heartbeat_ns=500 * MS, others_ns=others_ns)
    assert classify(inputs) is kind


def test_death_needs_proof_of_the_link() -> None:
    inputs = LossInputs(10_000 * MS, gone_ns=600 * MS, heartbeat_ns=700 * MS)
    assert classify(inputs) is None
    assert classify(inputs._replace(hub_ns=100 * MS)) is LossKind.PROCESS_DEAD
