"""A claim that does not begin is told from one that is about to."""

from __future__ import annotations

from storage.jobs.claims import Claims


class Clock:
    now = 7.0

    def __call__(self) -> float:
        return self.now


def test_what_is_claimed_and_never_in_hand_is_forgotten_after_the_patience():
    clock = Clock()
    claims = Claims(10.0, clock=clock)
    assert claims.forgotten(["lost", "late", "begun"], in_hand=["begun"]) == []
    clock.now += 9.9
    assert claims.forgotten(["lost", "late", "begun"], in_hand=["begun"]) == []
    clock.now += 0.1
    assert claims.forgotten(["lost", "late", "begun"], in_hand=["late", "begun"]) == ["lost"]


def test_a_claim_that_was_in_hand_or_away_meanwhile_counts_anew():
    clock = Clock()
    claims = Claims(10.0, clock=clock)
    assert claims.forgotten(["held", "gone"], in_hand=[]) == []
    clock.now += 6.0
    assert claims.forgotten(["held"], in_hand=["held"]) == []
    clock.now += 6.0
    assert claims.forgotten(["held", "gone"], in_hand=[]) == []
    clock.now += 10.0
    assert claims.forgotten(["held", "gone"], in_hand=[]) == ["held", "gone"]
