"""What is known of every addressable scalar of a diagram: its value, unit, bounds and meaning."""

from __future__ import annotations

from engine.diagram.numbers import Numbers
from engine.model.parameters import Param, ParameterInfo


def describe(numbers: Numbers) -> dict[str, ParameterInfo]:
    """Return what is known of every addressable scalar.

    A system parameter that is itself the value of an element's parameter (``"=m"``) takes over its unit, bounds and scale
    where it has none of its own.
    """
    slots = numbers.bindings.slots
    named: dict[int, list[int]] = {}
    for index, slot in enumerate(slots):
        if slot.expression is not None and slot.expression.is_name:
            named.setdefault(slot.operands[0], []).append(index)

    def elements(index: int) -> list[Param]:
        found: list[Param] = []
        for user in named.get(index, ()):
            param = slots[user].param
            found.extend(elements(user) if user in numbers.declared else [param] if param is not None else [])
        return found

    described: dict[str, ParameterInfo] = {}
    for path, index in numbers.paths.items():
        slot, value = slots[index], numbers.bindings.base[index].real
        if index in numbers.declared:
            parameter, own = numbers.declared[index].parameter, numbers.declared[index].bounds
            heirs = elements(index)
            lowest = max([own, *heirs], key=lambda p: (p.lower, p.lower_open))
            described[path] = ParameterInfo(
                path=path, value=float(value), lower=lowest.lower, lower_open=lowest.lower_open,
                upper=min(p.upper for p in (own, *heirs)), bound=slot.expression is not None, doc=parameter.doc,
                unit=next((p.unit for p in (own, *heirs) if p.unit), ""),
                scale=parameter.scale or (heirs[0].scale if heirs else "linear"),
            )  # fmt: skip
        else:
            assert slot.param is not None  # a named slot belongs to an element or to the system
            described[path] = ParameterInfo(
                path=path, value=float(value), unit=slot.param.unit, lower=slot.param.lower, upper=slot.param.upper,
                lower_open=slot.param.lower_open, scale=slot.param.scale, doc=slot.param.doc,
                bound=slot.expression is not None,
            )  # fmt: skip
    return described
