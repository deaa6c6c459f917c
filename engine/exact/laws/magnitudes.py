"""How large what a signal is made of is: what its rounding is relative to, where large parts cancel.

A friction that holds a piston is the difference of two forces of pressure: near balance it is known to the rounding of these, not of itself.

    M(e) = |C3| |x| + |D31| |u| + |D32| |w| + |D33| M(v),   M(v) = max(|v|, |∂g/∂x| |x| + |∂g/∂e| M(e)),   M(f) alike;
    what is held: M(m) = |(∂ė/∂m)⁻¹| |∂e/∂x| M(f)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import slopes

if TYPE_CHECKING:
    from engine.exact.laws.system import Flow, Instants, NonlinearSystem

Real = npt.NDArray[np.float64]


def magnitudes(real: NonlinearSystem, at: Instants, flow: Flow) -> tuple[Real, Real]:
    """Return M(f) (N, states) and M(v) (N, channels) of a system of one real lane at N instants."""
    m = {name: np.abs(matrix[0]) for name, matrix in real.matrices.items()}
    nl = real.linear_states
    x, u, w = (np.abs(part[0]) for part in (at.x, at.u, at.w))
    v, f = np.abs(flow.v[0]), np.zeros_like(x)
    entering = x[:, :nl] @ m["c3"].T + u @ m["d31"].T + w @ m["d32"].T
    parts = [
        slopes(law.element, real.moment(law, at.t, at.x, flow.e), mode, law.real)
        for law, mode in zip(real.laws, at.modes, strict=True)
    ]
    held = [output for output, _ in real.holds(at.modes)]

    def join() -> Real:
        """Carry the magnitudes of outputs on to those that follow them; return those of the inputs."""
        for group in real.order:
            e = entering + v @ m["d33"].T
            for number in group.laws:
                law, part = real.laws[number], parts[number]
                size = _times(part.gx, x[:, law.states]) + _times(part.gz, e[:, law.inputs])
                for k in set(group.channels).intersection(range(law.outputs.start, law.outputs.stop)) - set(held):
                    v[:, k] = np.maximum(v[:, k], size[:, k - law.outputs.start])
        return np.asarray(entering + v @ m["d33"].T)

    def rates() -> None:
        e = join()
        f[:, :nl] = x[:, :nl] @ m["a"].T + u @ m["b1"].T + w @ m["b2"].T + v @ m["b3"].T
        for law, part in zip(real.laws, parts, strict=True):
            f[:, law.states] = _times(part.fx, x[:, law.states]) + _times(part.fz, e[:, law.inputs])

    rates()
    if held:
        tangent = real.tangent(at)
        v[:, held] = np.maximum(v[:, held], _times(np.linalg.inv(tangent.gain), _times(tangent.hold, f)))
        rates()
    return f, v


def _times(matrix: Any, vector: Real) -> Real:
    """Return |matrix| vector at every instant, what is not finite left out."""
    return np.asarray(np.nan_to_num(np.abs(matrix) @ vector[..., None], posinf=0.0)[..., 0])
