"""Machine code for one structure: the march of `engine.batch.kernels.marching` with the rows of the tapes in place of their interpretation.

Code is generated beside the work and takes the place of the tapes when it is ready. Diagrams of the same structure share it:
parameters and constants are data. One group of lanes is marched after the other, its states staying in the processor's registers.
"""

from __future__ import annotations

import ctypes
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, Final, TypeAlias

from llvmlite import binding, ir

from engine.batch.kernels import functions
from engine.batch.kernels.compiled import LANES
from engine.batch.nonlinear.arithmetic import Code
from engine.batch.nonlinear.lookback import Lookback
from engine.batch.nonlinear.program import Program, Real, Whole

_REMEMBERED: Final = 128
_WHOLE: Final = ir.IntType(64)
_NAME: Final = "march"
_BLOCKS: Final = ("entry", "group", "step", "note", "noted", "stages", "ready", "leave")
_SIGNATURE: Final = ctypes.CFUNCTYPE(
    None,
    ctypes.c_void_p,
    ctypes.c_int64,
    ctypes.c_void_p,
    ctypes.c_int64,
    ctypes.c_double,
    ctypes.c_int64,
    ctypes.c_void_p,
    ctypes.c_int64,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_int64,
    ctypes.c_int64,
)


Given: TypeAlias = tuple[Real, Lookback, Real]
"""Inputs, what delayed signals are made of, and the past that holds it."""


class Generated:
    """The code of a program: ``march`` is None until it is ready.

    It takes registers, what drives them, width and stride as `engine.batch.kernels.marching.march` does; what it writes down lies in a record
    (read, samples, groups, LANES), which may be a part of a longer one: nothing has to be turned round afterwards.
    """

    def __init__(self, program: Program) -> None:
        self.march: Callable[[Real, Given, float, int, Real], None] | None = None
        self._program = program
        self._engine: Any = None
        self._thread = threading.Thread(target=self._generate, name="code generation")
        self._thread.start()

    def wait(self) -> None:
        """Return when the code is ready."""
        self._thread.join()

    def _generate(self) -> None:
        module = ir.Module(name="program")
        _Writer(module, self._program).write()
        self._engine = _engine(str(module))
        run = _SIGNATURE(self._engine.get_function_address(_NAME))

        def march(registers: Real, pieces: Given, width: float, stride: int, record: Real) -> None:
            inputs, back, past = pieces
            apart = record.strides[0] // (LANES * record.itemsize)
            run(
                registers.ctypes.data, registers.shape[1], inputs.ctypes.data, len(inputs) // 3, width, stride,
                record.ctypes.data, apart, back.places.ctypes.data, back.shares.ctypes.data, past.ctypes.data, back.first,
                past.shape[1],
            )  # fmt: skip

        self.march = march  # one assignment: others see the whole code or none


_known: OrderedDict[Any, Generated] = OrderedDict()
_lock = threading.Lock()


def generated(program: Program) -> Generated:
    """Return the code of a program, being made if there is none yet."""
    with _lock:
        found = _known.pop(program.key, None) or Generated(program)
        _known[program.key] = found
        while len(_known) > _REMEMBERED:
            _known.popitem(last=False)
    return found


@cache
def _target() -> Any:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding.Target.from_default_triple()


def _engine(source: str) -> Any:
    module = binding.parse_assembly(source)
    module.verify()
    machine = _target().create_target_machine(  # an engine takes it for its own
        cpu=binding.get_host_cpu_name(), features=binding.get_host_cpu_features().flatten(), opt=2, jit=True
    )
    engine = binding.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return engine


class _Writer:
    """Writes a march of the program, for one group of lanes after the other."""

    def __init__(self, module: Any, program: Program) -> None:
        self._program = program
        whole, pointer = _WHOLE, ir.DoubleType().as_pointer()
        marched = [pointer, whole, pointer, whole, ir.DoubleType(), whole, pointer, whole]
        function = ir.Function(
            module,
            ir.FunctionType(ir.VoidType(), [*marched, whole.as_pointer(), pointer, pointer, whole, whole]),
            name=_NAME,
        )
        (
            self._registers, self._count, self._inputs, self._steps, self._width, self._stride, self._record, self._apart,
            self._places, self._shares, self._past, self._first, self._slots,
        ) = function.args  # fmt: skip
        self._at = {name: function.append_basic_block(name) for name in _BLOCKS}
        self._b = ir.IRBuilder(self._at["entry"])

    def write(self) -> None:
        """Write the function: a loop over groups, and in it one over steps, which ends behind the last one's beginning."""
        b, program, at = self._b, self._program, self._at
        # what is computed once for a candidate lies on the stack, at places that are known beforehand: asked for before all else
        once = range(program.first_once, program.first_once + program.once)
        self._once = {register: b.alloca(functions.DOUBLES) for register in once}
        self._vectors = b.bitcast(self._registers, functions.DOUBLES.as_pointer())
        self._recorded, self._heard = (
            b.bitcast(array, functions.DOUBLES.as_pointer()) for array in (self._record, self._past)
        )
        half, third, sixth, full = (
            self._spread(b.fmul(self._width, ir.Constant(ir.DoubleType(), part))) for part in (1 / 2, 1 / 3, 1 / 6, 1.0)
        )
        b.branch(at["group"])

        b.position_at_end(at["group"])
        self._group = b.phi(_WHOLE)
        self._group.add_incoming(_whole(0), at["entry"])
        start = [b.load(self._place(i), align=8) for i in range(program.states)]
        for register, slot in self._once.items():
            b.store(b.load(self._place(register), align=8), slot)
        b.branch(at["step"])

        b.position_at_end(at["step"])
        step, begin = b.phi(_WHOLE), [b.phi(functions.DOUBLES) for _ in start]
        self._enter((step, *begin), (_whole(0), *start), at["group"])
        row = b.mul(step, _whole(3))
        slopes = self._noted(step, self._run(program.whole, begin, row))

        b.position_at_end(at["stages"])
        total, now = self._moved(begin, slopes, sixth), self._moved(begin, slopes, half)
        for further, part in ((1, half), (1, full)):
            slopes = self._slopes(self._run(program.rates_only, now, b.add(row, _whole(further))))
            total, now = self._moved(total, slopes, third), self._moved(begin, slopes, part)
        slopes = self._slopes(self._run(program.rates_only, now, b.add(row, _whole(2))))
        total = self._moved(total, slopes, sixth)
        self._enter((step, *begin), (b.add(step, _whole(1)), *total), at["stages"])
        b.branch(at["step"])

        b.position_at_end(at["ready"])
        for i, x in enumerate(begin):
            b.store(x, self._place(i), align=8)
        following = b.add(self._group, _whole(1))
        self._group.add_incoming(following, at["ready"])
        b.cbranch(b.icmp_signed("<", following, self._count), at["group"], at["leave"])
        b.position_at_end(at["leave"])
        b.ret_void()

    def _noted(self, step: Any, held: dict[int, Any]) -> list[Any]:
        """Write what is read off down where it is asked for, and leave behind the last step; return x'."""
        b, at = self._b, self._at
        read = [self._value(held, register) for register in self._program.read.tolist()]
        slopes = self._slopes(held)
        for number, register in enumerate(self._program.entering.tolist()):
            place = self._slot(number, b.add(self._first, step))
            b.store(self._value(held, register), b.gep(self._heard, [place]), align=8)
        b.cbranch(b.icmp_signed("==", b.urem(step, self._stride), _whole(0)), at["note"], at["noted"])
        b.position_at_end(at["note"])
        sample = b.add(b.mul(b.udiv(step, self._stride), self._count), self._group)
        for number, x in enumerate(read):
            place = b.add(b.mul(self._apart, _whole(number)), sample)
            b.store(x, b.gep(self._recorded, [place]), align=8)
        b.branch(at["noted"])
        b.position_at_end(at["noted"])
        b.cbranch(b.icmp_signed("==", step, self._steps), at["ready"], at["stages"])
        return slopes

    def _run(self, tape: Whole, states: Sequence[Any], row: Any) -> dict[int, Any]:
        """Write the rows of a tape; ``row`` is that of the inputs. Return what is in the registers."""
        held = dict(enumerate(states))
        first = self._b.mul(row, _whole(self._program.inputs))
        for k in range(self._program.inputs):
            place = self._b.gep(self._inputs, [self._b.add(first, _whole(k))])
            held[self._program.states + k] = self._spread(self._b.load(place))
        held.update(self._delayed(row))
        for code, a, b, c, to in tape.tolist():
            emit, count = _EMIT[Code(code)]
            held[to] = emit(self._b, *(self._value(held, register) for register in (a, b, c)[:count]))
        return held

    def _delayed(self, row: Any) -> dict[int, Any]:
        """Write the delayed signals and their slopes at a row; return them by their registers."""
        b, count, found = self._b, len(self._program.entering) // 2, {}
        for k in range(count):
            entry = b.add(b.mul(row, _whole(count)), _whole(k))
            slot = b.load(b.gep(self._places, [entry]))
            places = [self._slot(number, b.add(slot, _whole(more))) for more in (0, 1) for number in (k, count + k)]
            around = [b.load(b.gep(self._heard, [place]), align=8) for place in places]
            for kind in (0, 1):
                total = None
                for number, value in enumerate(around):
                    share = b.gep(self._shares, [b.add(b.mul(entry, _whole(8)), _whole(4 * kind + number))])
                    part = self._spread(b.load(share))
                    total = b.fmul(value, part) if total is None else functions.product_and_sum(b, value, part, total)
                found[self._program.states + self._program.inputs + kind * count + k] = total
        return found

    def _slot(self, number: int, slot: Any) -> Any:
        """Return the place of a slot among all that is looked back at."""
        b = self._b
        return b.add(b.mul(b.add(b.mul(_whole(number), self._slots), slot), self._count), self._group)

    def _value(self, held: dict[int, Any], register: int) -> Any:
        return held[register] if register in held else self._b.load(self._once[register])

    def _slopes(self, held: dict[int, Any]) -> list[Any]:
        return [self._value(held, register) for register in self._program.rates.tolist()]

    def _moved(self, x: Sequence[Any], slopes: Sequence[Any], part: Any) -> list[Any]:
        return [functions.product_and_sum(self._b, slope, part, own) for own, slope in zip(x, slopes, strict=True)]

    def _place(self, register: int) -> Any:
        return self._b.gep(self._vectors, [self._b.add(self._b.mul(self._count, _whole(register)), self._group)])

    def _enter(self, own: Iterable[Any], values: Iterable[Any], block: Any) -> None:
        """Give the numbers of a loop what they are when it is entered from a block."""
        for phi, x in zip(own, values, strict=True):
            phi.add_incoming(x, block)

    def _spread(self, scalar: Any) -> Any:
        one = self._b.insert_element(ir.Constant(functions.DOUBLES, ir.Undefined), scalar, _index(0))
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return self._b.shuffle_vector(one, ir.Constant(functions.DOUBLES, ir.Undefined), mask)


def _whole(number: int) -> Any:
    return ir.Constant(_WHOLE, number)


def _index(number: int) -> Any:
    return ir.Constant(ir.IntType(32), number)


def _negative(builder: Any, a: Any) -> Any:
    return builder.fsub(functions.spread(-0.0), a)


_EMIT: Final[Mapping[Code, tuple[Callable[..., Any], int]]] = {
    Code.ADD: (lambda w, a, b: w.fadd(a, b), 2),
    Code.SUB: (lambda w, a, b: w.fsub(a, b), 2),
    Code.MUL: (lambda w, a, b: w.fmul(a, b), 2),
    Code.DIV: (lambda w, a, b: w.fdiv(a, b), 2),
    Code.NEG: (_negative, 1),
    Code.SQRT: (lambda w, a: functions.called(w, "sqrt", a), 1),
    Code.EXP: (functions.exponential, 1),
    Code.LOG: (lambda w, a: functions.called(w, "log", a), 1),
    Code.SIN: (lambda w, a: functions.called(w, "sin", a), 1),
    Code.COS: (lambda w, a: functions.called(w, "cos", a), 1),
    Code.IS_ZERO: (
        lambda w, a: w.select(
            w.fcmp_ordered("==", a, functions.spread(0.0)), functions.spread(1.0), functions.spread(0.0)
        ),
        1,
    ),
    Code.TANH: (functions.hyperbolic_tangent, 1),
    Code.LARGER: (functions.larger, 2),
    Code.SMALLER: (functions.smaller, 2),
    Code.CHOOSE: (lambda w, a, b, c: w.select(functions.positive(w, a), b, c), 3),
    Code.MULTIPLY_ADD: (functions.product_and_sum, 3),
    Code.MULTIPLY_SUBTRACT: (lambda w, a, b, c: functions.product_and_sum(w, a, b, _negative(w, c)), 3),
    Code.SUBTRACT_PRODUCT: (lambda w, a, b, c: functions.product_and_sum(w, _negative(w, a), b, c), 3),
    Code.COPY: (lambda _, a: a, 1),
}  # fmt: skip
