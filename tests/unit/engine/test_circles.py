"""Strongly connected components, against scipy's, and their order."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from engine.model.strongly_connected_components import circles


@pytest.mark.parametrize("seed", range(20))
def test_groups_are_those_of_scipy_and_come_after_what_they_need(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 30))
    graph = random.random((count, count)) < random.uniform(0, 3) / count
    groups = circles([np.flatnonzero(row).tolist() for row in graph])
    _, label = connected_components(graph, directed=True, connection="strong")
    assert {tuple(group) for group in groups} == {tuple(np.flatnonzero(label == k)) for k in set(label)}
    done: set[int] = set()
    for group in groups:
        done.update(group)
        assert all(set(np.flatnonzero(graph[node])) <= done for node in group)


def test_a_long_chain_takes_no_recursion() -> None:
    assert circles([[k + 1] for k in range(4999)] + [[0]]) == [list(range(5000))]
    assert circles([[k + 1] for k in range(4999)] + [[]]) == [[k] for k in reversed(range(5000))]
