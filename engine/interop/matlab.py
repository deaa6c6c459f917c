"""The realised system as a MATLAB file (version 5), readable by MATLAB, Octave and scipy.

Without delays `ss(A, B, C, D)` makes the model of it; with delays
`setDelayModel(A, B1, B2, C1, C2, D11, D12, D21, D22, delays)`.
"""

from __future__ import annotations

import io

import numpy as np
from scipy.io import savemat

from engine.interop.matrices import Matrices


def mat(matrices: Matrices) -> bytes:
    """Return the content of a .mat file: the matrices, and the names of states, inputs, outputs and channels as cell arrays."""
    file = io.BytesIO()
    system = matrices.system
    names = {
        "states": matrices.states,
        "inputs": system.inputs,
        "outputs": system.outputs,
        "output_units": matrices.output_units,
        "channels": matrices.channels,
    }
    cells = {name: np.array(texts, dtype=object).reshape(-1, 1) for name, texts in names.items()}
    columns = {name: array.reshape(-1, 1) if array.ndim == 1 else array for name, array in matrices.arrays.items()}
    savemat(file, {**columns, **cells}, do_compression=True)  # type: ignore[arg-type]  # the stubs know paths only
    return file.getvalue()
