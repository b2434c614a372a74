"""Sixteen numbers side by side in a compiled loop, as one value that the processor's vector registers hold.

Numba makes vector instructions of a loop over a few numbers only where its compiler can prove that no two arrays overlap, which it cannot
for the rows of a band matrix. A kernel that says itself what goes side by side runs several times as fast. Lanes are added, subtracted,
multiplied and divided by the usual signs. What reads and writes them takes a flat array of float32, and a place in it that is not checked.
The functions here are for compiled loops only.
"""

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, no_type_check

from llvmlite import ir
from numba import njit
from numba.core import types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global
from numba.extending import lower_builtin, register_model

LANES = 16
_HALF, _FLOATS, _PAIRS = (ir.VectorType(ir.FloatType(), count) for count in (LANES // 2, LANES, 2 * LANES))
_INDEX = ir.IntType(32)
_ALIGNED = 4  # bytes
_FUSED = ("contract",)  # a product and a sum may be rounded once, which the processor does in one instruction


class _Lanes(types.Type):
    """LANES numbers of 32 bits."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


class _LanesModel(PrimitiveModel):
    """They are a vector to the compiler."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _FLOATS)


register_model(_Lanes)(_LanesModel)
_lanes, _complex, _array, _place, _number = _Lanes(), types.UniTuple(_Lanes(), 2), None, types.intp, types.float32


@dataclass(frozen=True, kw_only=True)
class _Compiler:
    """What writes a function's instructions."""

    context: Any
    builder: Any

    def read(self, data: Any, at: Any, kind: Any) -> Any:
        """A vector from a place of an array on."""
        value = self.builder.load(self._pointer(data, at, kind))
        value.align = _ALIGNED
        return value

    def write(self, value: Any, data: Any, at: Any) -> None:
        """A vector into an array."""
        self.builder.store(value, self._pointer(data, at, value.type)).align = _ALIGNED

    def picked(self, order: Sequence[int], first: Any, second: Any = None) -> Any:
        """Some of a vector's numbers, or of two vectors' after one another."""
        mask = ir.Constant(ir.VectorType(_INDEX, len(order)), list(order))
        return self.builder.shuffle_vector(first, first if second is None else second, mask)

    def called(self, name: str, value: Any) -> Any:
        """What a function of the compiler's own makes of each number."""
        function = self.builder.module.declare_intrinsic(f"{name}.v{LANES}f32", fnty=ir.FunctionType(_FLOATS, [_FLOATS]))
        return self.builder.call(function, [value])

    def of_numbers(self, numbers: Sequence[Any]) -> Any:
        """A vector of single numbers."""
        value = ir.Constant(ir.VectorType(ir.FloatType(), len(numbers)), ir.Undefined)
        for k, number in enumerate(numbers):
            value = self.builder.insert_element(value, number, ir.Constant(_INDEX, k))
        return value

    def _pointer(self, data: Any, at: Any, kind: Any) -> Any:
        return self.builder.bitcast(self.builder.gep(data, [at]), kind.as_pointer())


def _compiled(function: Callable[..., Any], answer: Any, *kinds: Any) -> Callable[[Callable[..., Any]], None]:
    """Tells numba what a function of such arguments answers, and the instructions that it is made of."""
    template = {"generic": lambda _self, given, _named: answer(*given)}
    infer_global(function)(type(function.__name__, (AbstractTemplate,), template))  # pyright: ignore[reportOptionalCall]

    def lowering(code: Callable[..., Any]) -> None:
        def lowered(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            given = [
                context.make_array(kind)(context, builder, value).data if wanted is None else context.cast(builder, value, kind, wanted)
                for wanted, kind, value in zip(kinds, signature.args, values, strict=True)
            ]
            made = code(_Compiler(context=context, builder=builder), *given)
            if answer is types.void:
                return context.get_dummy_value()
            return context.make_tuple(builder, answer, made) if answer is _complex else made

        lower_builtin(function, types.VarArg(types.Any))(lowered)

    return lowering


def load(array: Any, at: int) -> Any:
    """LANES numbers from a place on."""
    raise NotImplementedError


@_compiled(load, _lanes, _array, _place)
def _load(to: _Compiler, data: Any, at: Any) -> Any:
    return to.read(data, at, _FLOATS)


def store(array: Any, at: int, value: Any) -> None:
    """LANES numbers into the array, from a place on."""
    raise NotImplementedError


@_compiled(store, types.void, _array, _place, _lanes)
def _store(to: _Compiler, data: Any, at: Any, value: Any) -> None:
    to.write(value, data, at)


def load_halves(array: Any, first: int, second: int) -> Any:
    """LANES / 2 numbers from each of two places on, side by side."""
    raise NotImplementedError


@_compiled(load_halves, _lanes, _array, _place, _place)
def _load_halves(to: _Compiler, data: Any, first: Any, second: Any) -> Any:
    return to.picked(range(LANES), to.read(data, first, _HALF), to.read(data, second, _HALF))


def store_half(array: Any, at: int, value: Any) -> None:
    """The first half of the lanes into the array, from a place on."""
    raise NotImplementedError


@_compiled(store_half, types.void, _array, _place, _lanes)
def _store_half(to: _Compiler, data: Any, at: Any, value: Any) -> None:
    to.write(to.picked(range(LANES // 2), value), data, at)


def add_halves(array: Any, first: int, second: int, value: Any) -> None:
    """Adds the first half of the lanes to the array's numbers from one place on, then the second half to those from another."""
    raise NotImplementedError


@_compiled(add_halves, types.void, _array, _place, _place, _lanes)
def _add_halves(to: _Compiler, data: Any, first: Any, second: Any, value: Any) -> None:
    for half, at in enumerate((first, second)):
        part = to.picked(range(half * LANES // 2, (half + 1) * LANES // 2), value)
        to.write(to.builder.fadd(to.read(data, at, _HALF), part), data, at)


def load_complex(array: Any, at: int) -> Any:
    """The real and the imaginary parts of LANES complex numbers, which lie as pairs, from a place on."""
    raise NotImplementedError


@_compiled(load_complex, _complex, _array, _place)
def _load_complex(to: _Compiler, data: Any, at: Any) -> Any:
    pairs = to.read(data, at, _PAIRS)
    return [to.picked(range(part, 2 * LANES, 2), pairs) for part in (0, 1)]


def store_complex(array: Any, at: int, re: Any, im: Any) -> None:
    """LANES complex numbers as pairs into the array, from a place on."""
    raise NotImplementedError


@_compiled(store_complex, types.void, _array, _place, _lanes, _lanes)
def _store_complex(to: _Compiler, data: Any, at: Any, re: Any, im: Any) -> None:
    to.write(to.picked([b + part * LANES for b in range(LANES) for part in (0, 1)], re, im), data, at)


def alike(number: Any) -> Any:
    """A number in all lanes."""
    raise NotImplementedError


@_compiled(alike, _lanes, _number)
def _alike(to: _Compiler, number: Any) -> Any:
    return to.picked([0] * LANES, to.of_numbers([number]))


def alike_halves(first: Any, second: Any) -> Any:
    """One number in the first half of the lanes, another in the second."""
    raise NotImplementedError


@_compiled(alike_halves, _lanes, _number, _number)
def _alike_halves(to: _Compiler, first: Any, second: Any) -> Any:
    return to.picked([k for k in (0, 1) for _ in range(LANES // 2)], to.of_numbers([first, second]))


def swapped(value: Any) -> Any:
    """The two halves of the lanes, swapped."""
    raise NotImplementedError


@_compiled(swapped, _lanes, _lanes)
def _swapped(to: _Compiler, value: Any) -> Any:
    return to.picked([(b + LANES // 2) % LANES for b in range(LANES)], value)


def exceeds(value: Any, least: Any) -> Any:
    """1 where a value's magnitude is larger than another value, 0 elsewhere."""
    raise NotImplementedError


@_compiled(exceeds, _lanes, _lanes, _lanes)
def _exceeds(to: _Compiler, value: Any, least: Any) -> Any:
    return to.builder.uitofp(to.builder.fcmp_ordered(">", to.called("llvm.fabs", value), least), _FLOATS)


def root(value: Any) -> Any:
    """The square root of each."""
    raise NotImplementedError


@_compiled(root, _lanes, _lanes)
def _root(to: _Compiler, value: Any) -> Any:
    return to.called("llvm.sqrt", value)


def exponential(value: Any) -> Any:
    """e to the power of each."""
    raise NotImplementedError


@_compiled(exponential, _lanes, _lanes)
def _exponential(to: _Compiler, value: Any) -> Any:
    return to.called("llvm.exp", value)


def larger(first: Any, second: Any) -> Any:
    """The larger of both, lane by lane."""
    raise NotImplementedError


@_compiled(larger, _lanes, _lanes, _lanes)
def _larger(to: _Compiler, first: Any, second: Any) -> Any:
    return to.builder.select(to.builder.fcmp_ordered(">", first, second), first, second)


def total(value: Any) -> Any:
    """The sum over the lanes."""
    raise NotImplementedError


@_compiled(total, _number, _lanes)
def _total(to: _Compiler, value: Any) -> Any:
    count = LANES
    while count > 1:
        count //= 2
        value = to.builder.fadd(to.picked(range(count), value), to.picked(range(count, 2 * count), value))
    return to.builder.extract_element(value, ir.Constant(_INDEX, 0))


def _arithmetic(sign: Any, instruction: str) -> None:
    """Two values, lane by lane."""

    def code(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return getattr(builder, instruction)(*values, flags=_FUSED)

    cases = {"cases": [_lanes(_lanes, _lanes)]}
    infer_global(sign)(type(instruction, (ConcreteTemplate,), cases))  # pyright: ignore[reportOptionalCall]
    lower_builtin(sign, _lanes, _lanes)(code)


for _sign, _instruction in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _arithmetic(_sign, _instruction)


@no_type_check
@njit(cache=True)
def gathered(spectra, rows, frequencies, block, lanes):
    """Column block `block` of flat spectra (rows, frequencies) as lanes (rows, 2), the real and the imaginary parts."""
    first = block * LANES
    live = min(LANES, frequencies - first)
    for i in range(rows):
        at = 2 * (i * frequencies + first)
        if live == LANES:
            re, im = load_complex(spectra, at)
            store(lanes, 2 * i * LANES, re)
            store(lanes, (2 * i + 1) * LANES, im)
        else:
            for b in range(LANES):
                lanes[2 * i * LANES + b] = spectra[at + 2 * b] if b < live else 0
                lanes[(2 * i + 1) * LANES + b] = spectra[at + 2 * b + 1] if b < live else 0


@no_type_check
@njit(cache=True)
def scattered(lanes, rows, frequencies, block, spectra):
    """The inverse of `gathered`: lanes into the column block of flat spectra."""
    first = block * LANES
    live = min(LANES, frequencies - first)
    for i in range(rows):
        at = 2 * (i * frequencies + first)
        if live == LANES:
            store_complex(spectra, at, load(lanes, 2 * i * LANES), load(lanes, (2 * i + 1) * LANES))
        else:
            for b in range(live):
                spectra[at + 2 * b] = lanes[2 * i * LANES + b]
                spectra[at + 2 * b + 1] = lanes[(2 * i + 1) * LANES + b]
