"""Robot arm as a compliant structure between base and end-effector, by its modes of vibration.

q_i'' + 2 d_i w_i q_i' + w_i² q_i = φ_b,i (F_b + F_d) + φ_e,i (F_e - F_d),   x_b = Σ φ_b,i q_i,   x_e = Σ φ_e,i q_i
x_e/F_b = x_b/F_e = Σ φ_b,i φ_e,i / (s² + 2 d_i w_i s + w_i²)
"""

from __future__ import annotations

from collections.abc import Sequence

from engine.elements._base import Element, Ports, Realization, Values, by_rates, matrix
from engine.model.errors import DiagramError
from engine.model.parameters import Param, Scalar

MOTION = ("position", "velocity", "acceleration")
MOTION_UNITS = ("m", "m/s", "m/s**2")


class CompliantArm(Element):
    """Fig. 1 of the paper: force and motion at the base and at the end-effector, and a damper between the two.

    The four lists have an entry for each mode; the mode shapes are scaled to a modal mass of 1 kg, as finite-element programs and
    modal analysis give them. A frequency of 0 is a motion as a rigid body.

    ``damper_force`` is that of an element between the two: positive, it holds the end-effector back and takes the base
    along. ``stroke`` and ``stroke_velocity``, end-effector less base, drive that element: so a `viscous_damper`
    from stroke_velocity to damper_force takes energy out.
    """

    kind = "compliant_arm"
    title = "Compliant arm"
    equation = "q_i'' + 2 d_i w_i q_i' + w_i² q_i = φ_b,i (F_b + F_d) + φ_e,i (F_e - F_d);  x_b = Σ φ_b,i q_i;  x_e = Σ φ_e,i q_i"
    source = (
        "D. J. Ewins, Modal Testing, Research Studies Press 2000, chapter 2 (modal superposition, reciprocity); "
        "Assisted optimization of the dynamic behaviour of industrial robots, Fig. 1."
    )
    parameters = (
        Param(
            name="frequencies", symbol="w", unit="rad/s", shape="list", lower=0.0,
            doc="undamped angular frequency of each mode; 0 for a motion as a rigid body",
        ),
        Param(
            name="damping_ratios", symbol="d", unit="1", shape="list", lower=0.0,
            doc="damping ratio of each mode",
        ),
        Param(
            name="base_shape", symbol="φ_b", shape="list",
            doc="each mode's amplitude at the base, in kg^(-1/2)",
        ),
        Param(
            name="end_effector_shape", symbol="φ_e", shape="list",
            doc="each mode's amplitude at the end-effector, in kg^(-1/2)",
        ),
    )  # fmt: skip
    example = {
        "frequencies": [40.0, 95.0],
        "damping_ratios": [0.02, 0.03],
        "base_shape": [0.05, 0.09],
        "end_effector_shape": [0.2, -0.12],
    }

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse lists that are empty or not of one length."""
        modes = len(values["frequencies"])
        if not modes:
            raise DiagramError("frequencies must have at least 1 mode, got none", at=("frequencies",))
        for name in ("damping_ratios", "base_shape", "end_effector_shape"):
            if len(values[name]) != modes:
                raise DiagramError(
                    f"{name} must have an entry for each of the {modes} frequencies, got {len(values[name])}",
                    at=(name,),
                )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the forces; the motion at both ends and of one against the other."""
        return Ports(
            inputs=("base_force", "end_effector_force", "damper_force"),
            outputs=(
                *(f"base_{name}" for name in MOTION),
                *(f"end_effector_{name}" for name in MOTION),
                "stroke",
                "stroke_velocity",
            ),
            output_units=(*MOTION_UNITS, *MOTION_UNITS, "m", "m/s"),
        )

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the displacements of all modes (m·kg^(1/2)) and their velocities as states."""
        base, end = values["base_shape"], values["end_effector_shape"]
        modes = range(len(base))
        none: list[Scalar] = [0.0 for _ in modes]
        stiffness = [w * w for w in values["frequencies"]]
        damping = [2.0 * d * w for d, w in zip(values["damping_ratios"], values["frequencies"], strict=True)]
        stroke = [e - b for b, e in zip(base, end, strict=True)]
        forces = [[b, e, -s] for b, e, s in zip(base, end, stroke, strict=True)]
        rows: list[list[Scalar]] = []
        direct: list[list[Scalar]] = []
        for shape in (base, end):
            rows += [
                [*shape, *none],
                [*none, *shape],
                [
                    *[-p * k for p, k in zip(shape, stiffness, strict=True)],
                    *[-p * d for p, d in zip(shape, damping, strict=True)],
                ],
            ]
            direct += [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [_sum(shape, column) for column in zip(*forces, strict=True)]]
        c = matrix([*rows, [*stroke, *none], [*none, *stroke]])
        d = matrix([*direct, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        return Realization(
            a=matrix([
                *[[*none, *_diagonal(i, none, 1.0)] for i in modes],
                *[[*_diagonal(i, none, -stiffness[i]), *_diagonal(i, none, -damping[i])] for i in modes],
            ]),
            b=matrix([*[[0.0, 0.0, 0.0] for _ in modes], *forces]),
            c=c, d=d, reading=by_rates(c, d, {2: [*none, *base], 5: [*none, *end]}),
        )  # fmt: skip


def _diagonal(place: int, row: Sequence[Scalar], entry: Scalar) -> list[Scalar]:
    return [entry if i == place else other for i, other in enumerate(row)]


def _sum(shape: Sequence[Scalar], column: Sequence[Scalar]) -> Scalar:
    total: Scalar = 0.0
    for p, f in zip(shape, column, strict=True):
        total = total + p * f
    return total
