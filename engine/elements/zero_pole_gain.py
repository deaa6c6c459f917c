"""Transfer function by its zeros, poles and gain, realised as a cascade of sections.

y/u = gain (s - z1)(s - z2) ... / ((s - p1)(s - p2) ...)

A cascade keeps multiple and widely spread poles exact, where the expanded polynomial moves them (ten poles at -2: by 0.1).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from engine.elements._base import Element, Ports, Realization, Values
from engine.elements._canonical import Root, cascade
from engine.model.errors import DiagramError
from engine.model.parameters import Param, Scalar
from engine.model.traced import Op, Traced

_SAME = 1e-12  # two numbers written as conjugates may differ in their last digits


class ZeroPoleGain(Element):
    """Zeros and poles are numbers or ``[re, im]``; of a complex pair both members are listed."""

    kind = "zero_pole_gain"
    title = "Zeros, poles, gain"
    equation = "y/u = gain · Π (s - z_i) / Π (s - p_i)"
    source = "T. Kailath, Linear Systems, Prentice-Hall 1980, section 2.1 (series connection)."
    parameters = (
        Param(name="zeros", symbol="z", shape="roots", default=(), doc="numbers or [re, im], at most as many as poles"),
        Param(name="poles", symbol="p", shape="roots", doc="numbers or [re, im], conjugates complete"),
        Param(name="gain", symbol="k", default=1.0, doc="gain of the factored form (not the static gain)"),
    )
    example = {"zeros": [-5.0], "poles": [[-1.0, 3.0], [-1.0, -3.0]], "gain": 2.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the sections in series."""
        zeros, poles = _paired(values["zeros"], "zeros"), _paired(values["poles"], "poles")
        if sum(zero.order for zero in zeros) > sum(pole.order for pole in poles):
            raise DiagramError("zeros must not be more than poles: an improper transfer function has no response",
                               at=("zeros",))  # fmt: skip
        return cascade(zeros, poles, values["gain"])


def _paired(roots: Sequence[Scalar | Sequence[Scalar]], name: str) -> list[Root]:
    """Return real roots and one member of each complex pair."""
    found: list[Root] = []
    waiting: list[tuple[Scalar, Scalar]] = []
    for root in roots:
        re, im = _parts(root)
        if not (isinstance(im, Traced) or np.any(im.real)):
            found.append(Root(re=re, im=None))
            continue
        place = next((i for i, other in enumerate(waiting) if np.any(_conjugate((re, im), other))), None)
        if place is None:
            waiting.append((re, im))
            continue
        partner = waiting.pop(place)
        whole = _whole((re, im), partner)
        found.append(Root(re=(re + partner[0]) / 2.0 + whole, im=(im - partner[1]) / 2.0))
    if waiting:
        # Of a batch, the first member speaks for all: its structure is that of the document.
        alone = complex(*(np.atleast_1d(part.real)[0] for part in waiting[0]))
        raise DiagramError(f"{name} must contain the conjugate of {alone:g}", at=(name,))
    return found


def _parts(root: Scalar | Sequence[Scalar]) -> tuple[Scalar, Scalar]:
    if isinstance(root, Sequence):
        re, im = root
        return re, im
    return root, 0.0


def _whole(first: tuple[Scalar, Scalar], second: tuple[Scalar, Scalar]) -> Scalar:
    """Return 0, and no number where a pair falls apart: that member of a batch has no realisation, the others have."""
    if any(isinstance(part, np.ndarray) for part in (*first, *second)):
        return np.where(_conjugate(first, second), 0.0, np.nan)
    re, im = first[0] - second[0], first[1] + second[1]
    apart = re * re + im * im
    # A formula of a pair that differs in its last digits is left to the exact path.
    return 1.0 / apart.apply(Op.IS_ZERO) - 1.0 if isinstance(apart, Traced) else 0.0


def _conjugate(first: tuple[Scalar, Scalar], second: tuple[Scalar, Scalar]) -> npt.NDArray[np.bool_]:
    one, other = (np.asarray(re.real) + 1j * np.asarray(im.real) for re, im in (first, second))
    return np.asarray(np.abs(one - other.conj()) <= _SAME * np.abs(one))
