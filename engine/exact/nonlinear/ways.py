"""Which delays a change goes on into: a sampler on the way holds it back until it takes its next sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.elements._sampler import Sampler

if TYPE_CHECKING:
    from engine.exact.laws.system import NonlinearSystem

Flags = npt.NDArray[np.bool_]


class Ways:
    """What follows what between samples, at once or by way of states, whatever the values are.

    Attributes
    ----------
    from_commands : ndarray of bool, shape (m,)
        Into which of m delays goes what follows the commands,
    from_laws : ndarray of bool, shape (laws, m)
        the outputs of each law,
    from_delays : ndarray of bool, shape (m, m)
        what comes out of each delay.
    """

    def __init__(self, system: NonlinearSystem) -> None:
        m = {name: np.any(matrix != 0, axis=0) for name, matrix in system.matrices.items()}
        n, linear, (inputs, outputs) = system.states, system.linear_states, m["d33"].shape
        e, v = slice(n, n + inputs), slice(n + inputs, n + inputs + outputs)
        follows = np.eye(v.stop, dtype=bool)
        follows[:linear, :linear] |= m["a"]
        follows[:linear, v], follows[e, :linear], follows[e, v] = m["b3"], m["c3"], m["d33"]
        for law in system.laws:
            given, given_out = (slice(n + law.inputs.start, n + law.inputs.stop), _moved(law.outputs, n + inputs))
            follows[given_out, law.states] = True
            if not issubclass(law.element, Sampler):
                follows[given_out, given] = follows[law.states, given] = follows[law.states, law.states] = True
        while np.any((wider := follows @ follows) & ~follows):
            follows = wider
        entering = np.zeros((m["c2"].shape[0], v.stop), dtype=bool)
        entering[:, :linear], entering[:, v] = m["c2"], m["d23"]
        reached = entering @ follows

        def into(states: Flags, law_inputs: Flags, at_once: Flags) -> Flags:
            return np.asarray(reached[:, :linear] @ states | reached[:, e] @ law_inputs | at_once)

        self.from_commands = into(m["b1"], m["d31"], m["d21"]).any(axis=1)
        self.from_delays = into(m["b2"], m["d32"], m["d22"]).T
        own = [reached[:, _moved(law.outputs, n + inputs)].any(axis=1) for law in system.laws]
        self.from_laws = np.array(own, dtype=bool).reshape(len(own), len(entering))


def _moved(places: slice, by: int) -> slice:
    return slice(places.start + by, places.stop + by)
