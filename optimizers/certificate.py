"""The proof of an optimum: every goal in every scenario re-evaluated by the exact engine."""

from __future__ import annotations

from dataclasses import dataclass

from engine.verdicts import Measured

TOLERANCE = 1e-6
"""Largest violation (relative to the bound; SI where the bound is 0) at which a goal counts as met."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """One goal in the scenario that serves it worst; ``measured.at`` says when (s) or at which frequency (rad/s)."""

    goal: int
    scenario: int
    measured: Measured
    violation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """Every goal, exactly; ``valid`` when no violation exceeds 1e-6. ``where``: worst goal's time or frequency."""

    valid: bool
    worst_violation: float
    goals: tuple[Proof, ...]
