"""Mass on a spring and a damper, moved by a force and, where it can move, by its base.

m x'' + d (x' - x_b') + k (x - x_b) = F,   F_t = k (x - x_b) + d (x' - x_b')
x/F = 1/(m s² + d s + k),   x/x_b = (d s + k)/(m s² + d s + k)
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, by_rates, matrix
from engine.model.parameters import Param, Scalar


class MassSpringDamper(Element):
    """One degree of freedom. ``transmitted_force`` F_t is what spring and damper push the base with.

    ``base`` says how the base moves: ``fixed``; ``motion``, where its displacement and its velocity are inputs, as a drive
    gives both; or ``displacement``, where the displacement alone is known and may jump. Acceleration and transmitted
    force would then be derivatives of it, so they are no outputs.
    """

    kind = "mass_spring_damper"
    title = "Mass, spring and damper"
    equation = "m x'' + d (x' - x_b') + k (x - x_b) = F;  F_t = k (x - x_b) + d (x' - x_b')"
    source = "S. S. Rao, Mechanical Vibrations, Prentice Hall 2011, chapter 3 (harmonic force, motion of the base)."
    parameters = (
        Param(
            name="mass", symbol="m", unit="kg", lower=0.0, lower_open=True, scale="log",
            doc="moved mass",
        ),
        Param(
            name="stiffness", symbol="k", unit="N/m", lower=0.0, scale="log",
            doc="force of the spring for a stroke of 1 m",
        ),
        Param(
            name="damping", symbol="d", unit="N*s/m", lower=0.0, scale="log",
            doc="force of the damper for a velocity of 1 m/s",
        ),
        Param(
            name="base", symbol="x_b", shape="text", default="fixed", choices=("fixed", "displacement", "motion"),
            doc="how the base moves, and by which inputs",
        ),
    )  # fmt: skip
    example = {"mass": 100.0, "stiffness": 4e4, "damping": 200.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return force and motion of the base; motion of the mass and, where it exists, the transmitted force."""
        if values["base"] == "displacement":
            return Ports(
                inputs=("force", "base_displacement"), outputs=("position", "velocity"), output_units=("m", "m/s")
            )
        return Ports(
            inputs=("force",) if values["base"] == "fixed" else ("force", "base_displacement", "base_velocity"),
            outputs=("position", "velocity", "acceleration", "transmitted_force"),
            output_units=("m", "m/s", "m/s**2", "N"),
        )

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return position and velocity as states.

        Where the base jumps the second is the velocity that force and spring alone have made, p' = (F + k (x_b - x))/m, so
        that the damper's share d (x_b - x)/m need not be taken away from it again.
        """
        mass, stiffness, damping = values["mass"], values["stiffness"], values["damping"]
        pull, drag = stiffness / mass, damping / mass
        if values["base"] == "displacement":
            c, d = matrix([[1.0, 0.0], [-drag, 1.0]]), matrix([[0.0, 0.0], [0.0, drag]])
            return Realization(
                a=matrix([[-drag, 1.0], [-pull, 0.0]]), b=matrix([[0.0, drag], [1.0 / mass, pull]]), c=c, d=d,
                reading=by_rates(c, d, {1: [1.0, 0.0]}),
            )  # fmt: skip
        moving = values["base"] == "motion"

        def row(force: Scalar, displacement: Scalar, velocity: Scalar) -> list[Scalar]:
            return [force, displacement, velocity] if moving else [force]

        c = matrix([[1.0, 0.0], [0.0, 1.0], [-pull, -drag], [stiffness, damping]])
        d = matrix([
            row(0.0, 0.0, 0.0), row(0.0, 0.0, 0.0), row(1.0 / mass, pull, drag), row(0.0, -stiffness, -damping),
        ])  # fmt: skip
        return Realization(
            a=matrix([[0.0, 1.0], [-pull, -drag]]), b=matrix([row(0.0, 0.0, 0.0), row(1.0 / mass, pull, drag)]), c=c, d=d,
            reading=by_rates(c, d, {2: [0.0, 1.0]}),
        )  # fmt: skip
