"""Real quantities of a frequency response, each from its real and imaginary part, so that both carry their infinitesimals."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from engine.model.linear_system import Array

Shape = Callable[["Array", "Array"], "Array"]
"""A real quantity of the response from its real and imaginary part, e.g. |G|²."""


def squared_magnitude(re: Array, im: Array) -> Array:
    """|G|²."""
    return np.asarray(re * re + im * im)


def squared_error(re: Array, im: Array) -> Array:
    """|1 - G|²."""
    return np.asarray((1 - re) * (1 - re) + im * im)


def squared_sensitivity(re: Array, im: Array) -> Array:
    """|1 / (1 + L)|²."""
    return np.asarray(1 / ((1 + re) * (1 + re) + im * im))


def squared_balanced_sensitivity(re: Array, im: Array) -> Array:
    """|1 / (1 + L) - 1/2|², of which the symmetric disk margin is the inverse."""
    return np.asarray(0.25 * ((1 - re) * (1 - re) + im * im) * squared_sensitivity(re, im))


def squared_complementary(re: Array, im: Array) -> Array:
    """|L / (1 + L)|²."""
    return squared_magnitude(re, im) * squared_sensitivity(re, im)


def imaginary_part(_re: Array, im: Array) -> Array:
    """Im G: zero where the phase is a multiple of 180°."""
    return im
