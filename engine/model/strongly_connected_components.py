"""What depends on itself: the strongly connected components of a graph, in the order in which they can be computed.

References
----------
R. Tarjan, "Depth-first search and linear graph algorithms", SIAM Journal on Computing 1 (1972); here without recursion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence


def circles(needs: Sequence[Sequence[int]]) -> list[list[int]]:
    """Return the nodes in groups that need each other in circles, each group after those that it needs.

    Parameters
    ----------
    needs : sequence of sequence of int
        For each node those that it needs.

    Returns
    -------
    list of list of int
        Every node once; the members of a group in rising order. A node that is in no circle is a group of its own.
    """
    number: dict[int, int] = {}  # in the order of discovery
    earliest: dict[int, int] = {}  # the first node known to be in the same group
    open_: list[int] = []  # discovered, their group not complete
    waiting: set[int] = set()  # the same ones
    groups: list[list[int]] = []
    trail: list[tuple[int, Iterator[int]]] = []

    def enter(node: int) -> None:
        number[node] = earliest[node] = len(number)
        open_.append(node)
        waiting.add(node)
        trail.append((node, iter(needs[node])))

    for root in range(len(needs)):
        if root not in number:
            enter(root)
        while trail:
            node, others = trail[-1]
            for other in others:
                if other not in number:
                    enter(other)
                    break
                if other in waiting:
                    earliest[node] = min(earliest[node], number[other])
            else:
                trail.pop()
                if trail:
                    before = trail[-1][0]
                    earliest[before] = min(earliest[before], earliest[node])
                if earliest[node] == number[node]:
                    groups.append(_taken(open_, node))
                    waiting.difference_update(groups[-1])
    return groups


def _taken(open_: list[int], node: int) -> list[int]:
    """Take ``node`` and what was discovered after it."""
    place = len(open_) - 1
    while open_[place] != node:
        place -= 1
    group = sorted(open_[place:])
    del open_[place:]
    return group
