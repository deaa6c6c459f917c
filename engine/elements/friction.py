"""Friction with a true stick phase: viscous, Coulomb and Stribeck, not necessarily the same in both directions.

F = F_c + (F_s - F_c) exp(-(v/v_s)²) + b v   (v > 0, mirrored for v < 0);   v = 0: |F| <= F_s, whatever keeps v at 0
smoothly:   F = (F_c + (F_s - F_c) exp(-(v/v_s)²)) tanh(v/v_t) + b v
"""

from __future__ import annotations

from typing import Any

import numpy as np

from engine.elements._base import Array, Ports, Realization, Values, matrix
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals, first
from engine.model.errors import DiagramError
from engine.model.parameters import Param, Scalar

_SLIDE, _STICK, _JUMPED, _IDLE = 1, 0, 2, 3


class Friction(NonlinearElement):
    """Friction force of a velocity, positive with it: connect it where a positive force opposes the motion.

    The mass lies outside. When the velocity comes to 0 and the force that it takes to keep it there is below the static
    friction, it stays exactly 0, and the output is that force. Where the velocity is given from outside, so that no
    force could hold it, the output changes its sign with it. With a transition velocity there is no stick: a mass under
    a small force creeps, and everything is smooth.
    """

    kind = "friction"
    title = "Friction with stick"
    equation = "F = F_c + (F_s - F_c) exp(-(v/v_s)²) + b v for v > 0, mirrored for v < 0; |F| <= F_s at v = 0"
    source = "H. Olsson et al., Friction Models and Friction Compensation, Eur. J. Control 4 (1998) 176-195."
    note = "where friction sticks it counts with its viscous part alone: the mass does not move at small amplitude"
    modes = (-_SLIDE, _STICK, _SLIDE, _JUMPED, _IDLE)
    parameters = (
        Param(name="coulomb", symbol="F_c", unit="N", lower=0.0, doc="dry friction while sliding"),
        Param(name="viscous", symbol="b", unit="N*s/m", default=0.0, lower=0.0, doc="friction per velocity"),
        Param(
            name="static", symbol="F_s", unit="N", required=False, lower=0.0,
            doc="largest friction at rest; absent: as while sliding",
        ),
        Param(
            name="stribeck_velocity", symbol="v_s", unit="m/s", required=False, lower=0.0, lower_open=True,
            doc="velocity over which static turns into sliding friction; absent: at once",
        ),
        Param(
            name="coulomb_negative", symbol="F_c-", unit="N", required=False, lower=0.0,
            doc="the same for negative velocities; absent: as for positive ones",
        ),
        Param(
            name="viscous_negative", symbol="b-", unit="N*s/m", required=False, lower=0.0,
            doc="the same for negative velocities; absent: as for positive ones",
        ),
        Param(
            name="static_negative", symbol="F_s-", unit="N", required=False, lower=0.0,
            doc="the same for negative velocities; absent: as for positive ones",
        ),
        Param(
            name="transition_velocity", symbol="v_t", unit="m/s", required=False, lower=0.0, lower_open=True, scale="log",
            doc="velocity over which the friction builds up, as tanh, in place of a stick phase; absent: it sticks",
        ),
    )  # fmt: skip
    example = {"coulomb": 20.0, "viscous": 200.0, "static": 30.0, "stribeck_velocity": 0.5}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse static friction below sliding friction."""
        for side, name in ((1, "static"), (-1, "static_negative")):
            sliding, static = _side(side, values)[:2]
            if first(static) < first(sliding):
                raise DiagramError(
                    f"{name} must be >= the sliding friction ({first(sliding):g} N), got {first(static):g}",
                    at=(name,),
                )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return velocity and force."""
        return Ports(inputs=("velocity",), outputs=("force",), output_units=("N",))

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return sliding in the direction of the velocity, or sticking."""
        direction = int(np.sign(first(m.z[0])))
        return direction or (_STICK if values["transition_velocity"] is None else _SLIDE)

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the force of sliding; 0 at a velocity of 0 that is given from outside."""
        v = m.z[0]
        if abs(mode) != _SLIDE:
            return [0.0 * v]
        sliding, static, viscous = _side(mode, values)
        force: Any = sliding
        if values["stribeck_velocity"] is not None:
            force = force + (static - sliding) * np.exp(-((v / values["stribeck_velocity"]) ** 2))
        if values["transition_velocity"] is not None:
            return [force * np.tanh(v / values["transition_velocity"]) + viscous * v]
        return [mode * force + viscous * v]

    @classmethod
    def held(cls, mode: Mode) -> int | None:
        """Return that sticking holds the velocity."""
        return 0 if mode == _STICK else None

    @classmethod
    def idle(cls, mode: Mode) -> bool:
        """Return whether the velocity rests though the friction cannot hold it: at the end of a stroke, say."""
        return mode == _IDLE

    @classmethod
    def unheld(cls, m: Moment, mode: Mode, values: Values, *, before: Mode) -> Change:
        """Return the opposite direction: the velocity is given and passes through 0; or none where it rests."""
        return Change(mode=-before if abs(before) == _SLIDE else _IDLE)

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return that the direction is open after a jump of the velocity."""
        return Change(mode=_JUMPED if values["transition_velocity"] is None else mode)

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that without the velocities of Stribeck and transition the force is a straight line of the velocity."""
        return abs(mode) != _SLIDE or (values["stribeck_velocity"] is None and values["transition_velocity"] is None)

    @classmethod
    def describing_function(cls, amplitude: Array, values: Values) -> Array | None:
        """Return the mean over both directions of b + 4/(π A) (F_c + (F_s - F_c) D(a)/a), a = A/v_s, with Dawson's integral D.

        With a transition velocity it has no closed form.
        """
        if values["transition_velocity"] is not None:
            return None
        from scipy.special import dawsn  # noqa: PLC0415 - a twentieth of a second

        total: Array = np.zeros(np.shape(amplitude), dtype=complex)
        for side in (1, -1):
            sliding, static, viscous = _side(side, values)
            force = sliding + 0.0 * amplitude
            if values["stribeck_velocity"] is not None:
                a = amplitude / values["stribeck_velocity"]
                force = force + (static - sliding) * dawsn(a) / a
            total = total + 0.5 * (viscous + 4 * force / (np.pi * amplitude))
        return total

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the force is beyond what sticks, or the velocity beyond 0."""
        v = m.z[0]
        if mode == _STICK:
            return [m.y[0] - _side(1, values)[1], -_side(-1, values)[1] - m.y[0]]
        if abs(mode) == _SLIDE:
            return [-mode * v]
        return [v, -v, 1.0] if mode == _JUMPED else [v, -v]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return sliding in one direction, or sticking."""
        if abs(mode) == _SLIDE:
            return Change(mode=_STICK if values["transition_velocity"] is None else -mode)
        return Change(mode=(_SLIDE, -_SLIDE, _STICK)[guard])

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return the viscous part where it sticks; the slope of the curve while sliding."""
        return None if abs(mode) == _SLIDE else Realization.static(matrix([[values["viscous"]]]))


def _side(side: int, values: Values) -> tuple[Scalar, Scalar, Scalar]:
    """Return sliding and static friction and the viscous coefficient of one direction."""

    def of(name: str, otherwise: Scalar) -> Scalar:
        value: Scalar | None = values[f"{name}_negative"] if side < 0 else None
        return otherwise if value is None else value

    coulomb = of("coulomb", values["coulomb"])
    if side < 0 and values["static_negative"] is None and values["coulomb_negative"] is not None:
        # a direction with sliding friction of its own keeps the ratio of the other one where it has no static friction
        static = coulomb if values["static"] is None else coulomb * values["static"] / values["coulomb"]
    else:
        static = of("static", coulomb if values["static"] is None else values["static"])
    return coulomb, static, of("viscous", values["viscous"])
