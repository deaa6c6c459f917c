"""What is quick is told from what is large before anything is computed."""

from __future__ import annotations

import copy

import pytest

from api.services.jobs import costs
from api.services.systems.systems import compiled
from api.settings import Settings
from engine.diagram.diagram import Diagram
from tests.integration.api.documents import LAG, PNEUMATIC, chain

QUICK = Settings().quick_seconds


def diagram(document) -> Diagram:
    return compiled(copy.deepcopy(document), place=())


@pytest.mark.parametrize("document", [LAG, PNEUMATIC])
def test_a_small_system_is_quick_and_a_thousand_variants_of_it_are_not(document) -> None:
    small = diagram(document)
    assert 0.0 < costs.of_system(small) < 0.2 * QUICK
    assert costs.of_system(small, variants=1000) > QUICK


def test_a_chain_that_swings_for_long_is_large_unless_little_of_it_is_asked_for() -> None:
    swings = diagram(chain(5))
    assert costs.of_system(swings) > QUICK
    assert costs.of_system(swings, duration=0.01) < QUICK


def test_many_states_are_large_whatever_they_do() -> None:
    assert costs.of_system(diagram(chain(90)), duration=1e-6) > QUICK


def test_what_cannot_be_realised_is_told_by_whoever_computes_it() -> None:
    assert costs.of_system(diagram(LAG), overrides={"no.parameter": 1.0}) == 0.0
