"""A black box as a system document, which every other endpoint takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from optimizers.black_box.continuous import Continuous


def document_of(
    inputs: Sequence[str], outputs: Sequence[str], system: Continuous, delay: float, *, one_path: bool
) -> dict[str, Any]:
    """Return a system document with the model: a transfer function behind its delay where it is ``one_path``, else a state space."""
    blocks: dict[str, Any] = {name: {"kind": "input"} for name in inputs}
    wires: list[dict[str, str]] = []
    if one_path:
        denominator = np.poly(system.a).real
        numerator = np.poly(system.a - system.b @ system.c).real + (system.d[0, 0] - 1) * denominator
        numerator[np.abs(numerator) < 1e-12 * np.abs(denominator) * np.abs(numerator).max()] = 0.0
        blocks["model"] = {
            "kind": "transfer_function",
            "numerator": numerator.tolist(),
            "denominator": denominator.tolist(),
        }
        source = inputs[0]
        if delay:
            blocks["transport"] = {"kind": "delay", "time": delay}
            wires.append({"from": source, "to": "transport"})
            source = "transport"
        wires.append({"from": source, "to": "model"})
        return {"name": "black box", "blocks": blocks, "connections": wires, "outputs": {outputs[0]: "model"}}
    single_in, single_out = len(inputs) == 1, len(outputs) == 1
    blocks["model"] = {"kind": "state_space", **{k: getattr(system, k.lower()).tolist() for k in "ABCD"}}
    wires = [{"from": name, "to": "model" if single_in else f"model.in{k + 1}"} for k, name in enumerate(inputs)]
    reads = {name: "model" if single_out else f"model.out{k + 1}" for k, name in enumerate(outputs)}
    return {"name": "black box", "blocks": blocks, "connections": wires, "outputs": reads}
