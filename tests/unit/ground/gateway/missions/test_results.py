from gateways.mavlink.missions.plan_answers import ACCEPTED, PART_RESULTS, refusal_of
from gateways.mavlink.robot_port import Answered
from ground.client.results import Refused
from ground.missions.qgroundcontrol import ItemPart
from protocol.wire.reasons import Reason, reason_text
from tests.support.each import each


@each("reason", [reason for reason in Reason if reason])
def test_each_reason_is_refused_in_words(reason: Reason) -> None:
    refusal = refusal_of(Answered(Refused(reason, 1)), "mission", 1)
    assert refusal.result != ACCEPTED
    assert refusal.words == f"mission: {reason_text(reason)}"


def test_each_part_of_an_item_has_a_result() -> None:
    assert set(PART_RESULTS) == set(ItemPart)
    assert ACCEPTED not in PART_RESULTS.values()


def test_holder_of_the_lease_is_named() -> None:
    answered = Answered(Refused(Reason.LEASE_HELD, 1, "anna"))
    assert refusal_of(answered, "fence", 0).words.endswith(": anna")
