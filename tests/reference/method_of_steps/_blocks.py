"""Blocks for :mod:`tests.reference.method_of_steps._steps`, each from its textbook equations, in plain numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tests.reference.method_of_steps._steps import Block

Numbers = Sequence[float]


class Sum(Block):
    """y = Σ ± u_k."""

    def __init__(self, output: str, **signs: float) -> None:
        self.outputs, self.inputs, self.signs = (output,), tuple(signs), tuple(signs.values())

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (sum(s * v for s, v in zip(self.signs, z, strict=True)),)


class Product(Block):
    """y = u_1 u_2."""

    def __init__(self, output: str, *inputs: str) -> None:
        self.outputs, self.inputs = (output,), inputs

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (math.prod(z),)


class Integrator(Block):
    """y' = gain u."""

    direct = False

    def __init__(self, output: str, entering: str, gain: float = 1.0, initial: float = 0.0) -> None:
        self.outputs, self.inputs, self.start, self.gain = (output,), (entering,), (initial,), gain

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (x[0],)

    def rates(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (self.gain * z[0],)


class Lag(Block):
    """T y' + y = K u."""

    direct = False
    start = (0.0,)

    def __init__(self, output: str, entering: str, gain: float, time: float) -> None:
        self.outputs, self.inputs, self.gain, self.time = (output,), (entering,), gain, time

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (x[0],)

    def rates(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return ((self.gain * z[0] - x[0]) / self.time,)


class SecondOrder(Block):
    """y'' + 2 d w y' + w² y = K w² u; outputs y and y'."""

    direct = False
    start = (0.0, 0.0)

    def __init__(self, output: str, entering: str, gain: float, w: float, d: float) -> None:
        self.outputs, self.inputs, self.gain, self.w, self.d = (output, f"{output}'"), (entering,), gain, w, d

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return x[0], x[1]

    def rates(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return x[1], self.w**2 * (self.gain * z[0] - x[0]) - 2 * self.d * self.w * x[1]


class Pid(Block):
    """u = kp e + ki ∫ e dt + kd w (e - f), f' = w (e - f)."""

    start = (0.0, 0.0)

    def __init__(
        self, output: str, entering: str, *, kp: float, ki: float = 0.0, kd: float = 0.0, w: float = 1.0
    ) -> None:
        self.outputs, self.inputs = (output,), (entering,)
        self.kp, self.ki, self.kd, self.w = kp, ki, kd, w

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (self.kp * z[0] + self.ki * x[0] + self.kd * self.w * (z[0] - x[1]),)

    def rates(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return z[0], self.w * (z[0] - x[1])


class Saturation(Block):
    """y = min(max(u, lower), upper)."""

    def __init__(self, output: str, entering: str, lower: float, upper: float) -> None:
        self.outputs, self.inputs, self.limits = (output,), (entering,), (lower, upper)

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return ((self.limits[0], z[0], self.limits[1])[self.mode + 1],)

    def guards(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        lower, upper = self.limits
        if self.mode:
            return (upper - z[0],) if self.mode > 0 else (z[0] - lower,)
        return z[0] - upper, lower - z[0]

    def change(self, guard: int, t: float, x: Numbers, z: Numbers) -> None:
        self.mode = 0 if self.mode else (1, -1)[guard]


class DeadZone(Saturation):
    """What exceeds the limits."""

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return ((z[0] - self.limits[0], 0.0, z[0] - self.limits[1])[self.mode + 1],)


class Tanh(Block):
    """y = a tanh(u/a)."""

    def __init__(self, output: str, entering: str, limit: float) -> None:
        self.outputs, self.inputs, self.limit = (output,), (entering,), limit

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (self.limit * math.tanh(z[0] / self.limit),)


class Relay(Block):
    """High once u >= h/2, low once u <= -h/2; without hysteresis low at 0."""

    mode = -1

    def __init__(self, output: str, entering: str, low: float, high: float, hysteresis: float) -> None:
        self.outputs, self.inputs, self.values, self.half = (output,), (entering,), (low, high), hysteresis / 2

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (self.values[self.mode > 0],)

    def guards(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (-self.mode * z[0] - self.half,)

    def change(self, guard: int, t: float, x: Numbers, z: Numbers) -> None:
        self.mode = -self.mode


class Backlash(Block):
    """The output stands still inside the play, and follows at a flank; the inputs are u and u'."""

    start = (0.0,)

    def __init__(self, output: str, entering: str, rate: str, width: float) -> None:
        self.outputs, self.inputs, self.half = (output,), (entering, rate), width / 2

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (z[0] - self.mode * self.half if self.mode else x[0],)

    def rates(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return (0.0,)

    def guards(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        if self.mode:
            return (-self.mode * z[1],)
        return z[0] - self.half - x[0], x[0] - self.half - z[0]

    def change(self, guard: int, t: float, x: Numbers, z: Numbers) -> Numbers | None:
        if self.mode:
            left = z[0] - self.mode * self.half
            self.mode = 0
            return (left,)
        self.mode = (1, -1)[guard]
        return None


class Mass(Block):
    """m v' = F - f(v), x' = v; f is Coulomb friction with Stribeck's, which sticks, or smooth with a transition velocity.

    f = (F_c + (F_s - F_c) exp(-(v/v_s)²)) sign v + b v;   |f| <= F_s at v = 0, whatever keeps it there
    """

    direct = False

    def __init__(
        self, output: str, entering: str, mass: float, *, coulomb: float, static: float, stribeck: float, viscous: float,
        transition: float = 0.0, position: float = 0.0, velocity: float = 0.0,
    ) -> None:  # fmt: skip
        self.outputs, self.inputs, self.start = (output, f"{output}'"), (entering,), (position, velocity)
        self.mass, self.coulomb, self.static, self.stribeck = mass, coulomb, static, stribeck
        self.viscous, self.transition = viscous, transition
        self.mode = 1 if transition else int((velocity > 0) - (velocity < 0))

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return x[0], x[1]

    def friction(self, v: float) -> float:
        """Return the force while it moves."""
        dry = self.coulomb + (self.static - self.coulomb) * math.exp(-((v / self.stribeck) ** 2))
        return dry * (math.tanh(v / self.transition) if self.transition else self.mode) + self.viscous * v

    def rates(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        if self.mode == 0:
            return 0.0, 0.0
        return x[1], (self.drive(x, z) - self.friction(x[1])) / self.mass

    def drive(self, x: Numbers, z: Numbers) -> float:
        """Return the force without friction."""
        return z[0]

    def guards(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        if self.transition:
            return ()
        if self.mode:
            return (-self.mode * x[1],)
        force = self.drive(x, z)
        return force - self.static, -force - self.static

    def change(self, guard: int, t: float, x: Numbers, z: Numbers) -> Numbers | None:
        if self.mode == 0:
            self.mode = (1, -1)[guard]
            return None
        force = self.drive((x[0], 0.0, *x[2:]), z)
        self.mode = -self.mode if abs(force) > self.static and force * self.mode < 0 else 0
        return (x[0], 0.0, *x[2:])


class Cylinder(Mass):
    """A mass between two chambers of oil.

    p_a' = β/V_a (Q_a - A_a v - c (p_a - p_b)),   p_b' = β/V_b (Q_b + A_b v + c (p_a - p_b)),   F = A_a p_a - A_b p_b
    """

    def __init__(
        self, output: str, flows: tuple[str, str], mass: float, *, areas: tuple[float, float], dead: tuple[float, float],
        stroke: float, bulk: float, leakage: float, pressure: float, **friction: float,
    ) -> None:  # fmt: skip
        super().__init__(output, flows[0], mass, **friction)
        self.inputs, self.outputs = flows, (*self.outputs, f"{output}.a", f"{output}.b")
        self.areas, self.dead, self.stroke, self.bulk, self.leakage = areas, dead, stroke, bulk, leakage
        self.start = (0.5 * stroke, 0.0, pressure, pressure * areas[0] / areas[1])

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        return x

    def drive(self, x: Numbers, z: Numbers) -> float:
        return self.areas[0] * x[2] - self.areas[1] * x[3]

    def rates(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        velocity, acceleration = super().rates(t, x, z)
        leak = self.leakage * (x[2] - x[3])
        a = self.bulk / (self.dead[0] + self.areas[0] * x[0]) * (z[0] - self.areas[0] * x[1] - leak)
        room = self.dead[1] + self.areas[1] * (self.stroke - x[0])
        return velocity, acceleration, a, self.bulk / room * (z[1] + self.areas[1] * x[1] + leak)


class Valve(Block):
    """Four orifices: Q = g o Δp/(Δp² + p_l²)^(1/4), o = the spool beyond its overlap, at most its stroke."""

    def __init__(
        self, flows: tuple[str, str], entering: tuple[str, str, str], *, gain: float, overlap: float, stroke: float,
        supply: float, laminar: float,
    ) -> None:  # fmt: skip
        self.outputs, self.inputs = flows, entering
        self.gain, self.overlap, self.stroke, self.supply, self.laminar = gain, overlap, stroke, supply, laminar

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        spool, a, b = z
        if self.mode == 0:
            return 0.0, 0.0
        opening = abs(spool) - self.overlap if abs(self.mode) == 1 else self.stroke - self.overlap
        fed, drained = (a, b) if self.mode > 0 else (b, a)
        flow, back = (self._flow(opening, p) for p in (self.supply - fed, drained))
        return (flow, -back) if self.mode > 0 else (-back, flow)

    def _flow(self, opening: float, difference: float) -> float:
        return self.gain * opening * difference / (difference**2 + self.laminar**2) ** 0.25

    def guards(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        if self.mode == 0:
            return z[0] - self.overlap, -z[0] - self.overlap
        side = z[0] if self.mode > 0 else -z[0]
        return (self.overlap - side, side - self.stroke) if abs(self.mode) == 1 else (self.stroke - side,)

    def change(self, guard: int, t: float, x: Numbers, z: Numbers) -> None:
        if self.mode == 0:
            self.mode = (1, -1)[guard]
        elif abs(self.mode) == 1:
            self.mode = 0 if guard == 0 else 2 * self.mode
        else:
            self.mode //= 2


class Switched(Block):
    """A current that is on while a product of two signals is positive; smooth with a transition."""

    def __init__(self, output: str, entering: tuple[str, str], off: float, on: float, transition: float) -> None:
        self.outputs, self.inputs, self.currents, self.transition = (output,), entering, (off, on), transition

    def read(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        off, on = self.currents
        if self.transition:
            return (off + (on - off) * (1 + math.tanh(z[0] * z[1] / self.transition)) / 2,)
        return (self.currents[self.mode],)

    def guards(self, t: float, x: Numbers, z: Numbers) -> Numbers:
        if self.transition:
            return ()
        return (-z[0] * z[1] if self.mode else z[0] * z[1],)

    def change(self, guard: int, t: float, x: Numbers, z: Numbers) -> None:
        self.mode = 1 - self.mode
