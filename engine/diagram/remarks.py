"""What answers must say of a diagram that is nonlinear or takes samples: what they stand for and what they leave out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from engine.diagram.channels import Channels
from engine.elements._sampler import Sampler
from engine.exact.laws.laws import Law
from engine.model.document import Remark


def linearization(channels: Channels, constants: Mapping[str, float]) -> tuple[Remark, ...]:
    """Say that an answer is linearised, where there are nonlinear blocks, and what stands for slopes that do not exist."""
    if not channels:
        return ()
    given = ", ".join(f"{name} = {value:g}" for name, value in constants.items()) or "0"
    general = Remark(
        at=("blocks",), detail=f"the system is nonlinear: linearised about its operating point, inputs {given}"
    )
    return (general, *(Remark(at=block.at, detail=f"{block.path}: {note}") for block, note in channels.notes()))


def limited(laws: Sequence[Law]) -> list[Law]:
    """Return the samplers whose limits make them more than their linear part."""
    return [law for law in laws if issubclass(law.element, Sampler) and not law.element.linear(law.real)]


def sampled(
    samplers: Channels, channels: Channels, laws: Sequence[Law], constants: Mapping[str, float]
) -> tuple[Remark, ...]:
    """Say what an answer over frequency means with samplers."""
    detail = (
        "samplers are taken as they are: margins and poles are those of the map over their common period, a response is the "
        "part of the answer at the frequency of the input"
    )
    left_out = [
        Remark(
            at=law.at, detail=f"{law.label}: its limits are left out, margins and poles are those of its linear part"
        )
        for law in limited(laws)
    ]
    others = () if channels.numbers == samplers.numbers else linearization(channels, constants)
    besides = [remark for remark in others if not any(remark.at == block.at for block, _ in samplers.notes())]
    return (Remark(at=("blocks",), detail=detail), *left_out, *besides)
