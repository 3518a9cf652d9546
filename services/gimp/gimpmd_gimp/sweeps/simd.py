"""Small vectors that live in registers, for compiled sweeps: one component for each dimension.

The sweeps of GIMP are algebra with vectors of two or three components. The compiler does not
vectorize loops over so few components. A ``Vector(n)`` is held in the vector registers of the
processor, so that one instruction handles several components. In compiled functions

- ``load(axes, array, i)`` reads vector i, ``store`` and ``deposit`` write and add to one. It has
  ``d = len(axes)`` numbers, counted through the whole C-contiguous array, whatever its shape:
  ``load(axes, F, d * p + k)`` is row k of the tensor of point p;
- ``load_row(axes, array, i)`` reads vectors i, i + 1 and i + 2 as one of 3 d numbers, a *row*, and
  ``deposit_row`` adds to them; ``part(row, a)`` is one of the three, ``join`` makes a row of them;
- with three weights, ``outer(w, u)`` is the row ``(w_0 u, w_1 u, w_2 u)`` and ``contract(w, row)``
  the vector ``w_0 row_0 + w_1 row_1 + w_2 row_2``;
- ``+ - * /`` work by component, between vectors and between a vector and a number; ``u[k]`` is a
  component; ``floor``, ``minimum`` and ``maximum`` work by component too;
- ``at(array, i)`` reads number i of an array.

For speed, indices are neither checked nor counted from the end.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

Vector = Any
"""Type of a vector for the type checker."""

Codegen = Callable[[Any, Any, Any, Any], Any]

DOUBLE = ir.DoubleType()
INDEX = ir.IntType(64)
REGISTER = 4
ALIGNMENT = 8
"""Vectors may begin at any double."""


class VectorType(types.Type):  # type: ignore[misc]
    """numba's type of a vector of ``size`` doubles.

    The compiler handles sizes that fill a register well, and splits all others whenever a loop
    ends. Therefore a vector is a struct of registers of 1, 2 or 4 doubles: 3 is 4 with one unused,
    6 is 4 and 2, 9 is 4, 4 and 1. Rows of scalars, such as nodal masses, are fastest as 2 and 1.
    """

    def __init__(self, size: int, width: int = REGISTER) -> None:
        self.size, self.width = size, width
        super().__init__(name=f"Vector({size}, {width})")

    @property
    def lengths(self) -> list[int]:
        """Number of components in each register."""
        return [min(self.width, self.size - first) for first in range(0, self.size, self.width)]

    @property
    def registers(self) -> list[Any]:
        """LLVM types of the registers."""
        return [ir.VectorType(DOUBLE, 4 if n == 3 else n) for n in self.lengths]


def _row_of(d: int) -> VectorType:
    return VectorType(3 * d, REGISTER if d > 1 else 2)


@register_model(VectorType)
class VectorModel(models.PrimitiveModel):  # type: ignore[misc]
    """A vector is one LLVM value."""

    def __init__(self, manager: Any, kind: VectorType) -> None:
        super().__init__(manager, kind, ir.LiteralStructType(kind.registers))


def _unpack(builder: Any, value: Any) -> list[Any]:
    return [builder.extract_value(value, n) for n in range(len(value.type.elements))]


def _pack(builder: Any, registers: Sequence[Any]) -> Any:
    value = ir.Constant(ir.LiteralStructType([r.type for r in registers]), ir.Undefined)
    for n, register in enumerate(registers):
        value = builder.insert_value(value, register, n)
    return value


def _lane(k: int) -> Any:
    return ir.Constant(ir.IntType(32), k)


def _shuffle(builder: Any, a: Any, b: Any, lanes: Sequence[int]) -> Any:
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
    return builder.shuffle_vector(a, b, mask)


def _spread(builder: Any, number: Any, register: Any) -> Any:
    """Register with a number in all lanes."""
    one = builder.insert_element(ir.Constant(register, ir.Undefined), number, _lane(0))
    return _shuffle(builder, one, one, [0] * register.count)


def _operands(builder: Any, kind: VectorType, value: Any) -> list[Any]:
    """Registers of a vector, or of a number in all lanes."""
    if isinstance(value.type, ir.LiteralStructType):
        return _unpack(builder, value)
    return [_spread(builder, value, register) for register in kind.registers]


def _pick(builder: Any, kind: VectorType, value: Any, first: int, size: int) -> Any:
    """Components ``first`` to ``first + size`` of a vector, as a register."""
    registers = _unpack(builder, value)
    low, high = first // kind.width, (first + size - 1) // kind.width
    a, b = registers[low], registers[high]
    if a.type.count > b.type.count:
        lanes = [min(k, b.type.count - 1) for k in range(a.type.count)]
        b = _shuffle(builder, b, b, lanes)
    start = first - kind.width * low
    lanes = list(range(start, start + size)) + [start] * (
        VectorType(size).registers[0].count - size
    )
    return _shuffle(builder, a, b, lanes)


# --- arithmetic ---------------------------------------------------------------------------------


def _common(*kinds: Any) -> VectorType | None:
    """Vector type of an operation on numbers and vectors of one size; None for other operands."""
    vectors = {kind for kind in kinds if isinstance(kind, VectorType)}
    numbers = [kind for kind in kinds if not isinstance(kind, VectorType)]
    if len(vectors) != 1 or any(kind != types.float64 for kind in numbers):
        return None
    return vectors.pop()


class Arithmetic(AbstractTemplate):  # type: ignore[misc]
    """Typing of ``a op b`` where at least one operand is a vector."""

    def generic(self, args: Any, _: Any) -> Any:
        """Signature for these arguments, or None."""
        kind = _common(*args)
        return kind and kind(*args)


def _by_register(operation: Callable[[Any, Any, Any], Any]) -> Codegen:
    def codegen(_: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, b = (_operands(builder, signature.return_type, arg) for arg in args)
        return _pack(builder, [operation(builder, x, y) for x, y in zip(a, b, strict=True)])

    return codegen


def _define(op: object, instruction: str) -> None:
    """Teach numba an operator."""
    codegen = _by_register(lambda builder, x, y: getattr(builder, instruction)(x, y))
    infer_global(op)(type(instruction, (Arithmetic,), {}))
    for a, b in ((VectorType, VectorType), (types.Float, VectorType), (VectorType, types.Float)):
        lower_builtin(op, a, b)(codegen)


_define(operator.add, "fadd")
_define(operator.sub, "fsub")
_define(operator.mul, "fmul")
_define(operator.truediv, "fdiv")


def _choose(comparison: str) -> Callable[[Any, Any, Any], Any]:
    codegen = _by_register(
        lambda builder, x, y: builder.select(builder.fcmp_ordered(comparison, x, y), x, y)
    )

    def typed(_: Any, a: Any, b: Any) -> Any:
        kind = _common(a, b)
        return kind and (kind(a, b), codegen)

    return typed


minimum = intrinsic(_choose("<"))
maximum = intrinsic(_choose(">"))


@intrinsic
def floor(_: Any, u: Any) -> tuple[Any, Codegen] | None:
    """Largest integers not above the components."""

    def one(builder: Any, x: Any) -> Any:
        name = f"llvm.floor.v{x.type.count}f64"
        function = get_or_insert_function(builder.module, ir.FunctionType(x.type, [x.type]), name)
        return builder.call(function, [x])

    def codegen(_: Any, builder: Any, __: Any, args: Any) -> Any:
        return _pack(builder, [one(builder, x) for x in _unpack(builder, args[0])])

    return (u(u), codegen) if isinstance(u, VectorType) else None


@infer_global(operator.getitem)
class Component(AbstractTemplate):  # type: ignore[misc]
    """Typing of ``u[k]`` for a vector that fits into one register."""

    def generic(self, args: Any, _: Any) -> Any:
        """Signature for these arguments, or None."""
        vector, index = args
        if isinstance(vector, VectorType) and isinstance(index, types.Integer):
            return types.float64(vector, index) if vector.size < REGISTER else None
        return None


@lower_builtin(operator.getitem, VectorType, types.Integer)
def _component(_: Any, builder: Any, __: Any, args: Any) -> Any:
    return builder.extract_element(_unpack(builder, args[0])[0], args[1])


# --- memory -------------------------------------------------------------------------------------


def _holds_doubles(array: Any) -> bool:
    flat = isinstance(array, types.Array) and array.layout == "C"
    return flat and array.dtype == types.float64


def _pointer(context: Any, builder: Any, array: Any, value: Any, i: Any, unit: int) -> Any:
    """Where vector i of ``unit`` numbers begins in an array."""
    data = context.make_array(array)(context, builder, value).data
    return builder.gep(data, [builder.mul(i, ir.Constant(INDEX, unit))])


def _places(builder: Any, kind: VectorType, pointer: Any) -> list[Any]:
    """Pointers to the components in memory that go to each register."""
    places = []
    for n, length in enumerate(kind.lengths):
        first = builder.gep(pointer, [ir.Constant(INDEX, n * kind.width)])
        places.append(builder.bitcast(first, ir.VectorType(DOUBLE, length).as_pointer()))
    return places


def _read(builder: Any, kind: VectorType, pointer: Any) -> Any:
    registers = []
    for place, register in zip(_places(builder, kind, pointer), kind.registers, strict=True):
        found = builder.load(place, align=ALIGNMENT)
        if found.type != register:
            found = _shuffle(builder, found, found, [0, 1, 2, 0])
        registers.append(found)
    return _pack(builder, registers)


def _write(builder: Any, kind: VectorType, pointer: Any, value: Any) -> None:
    places = _places(builder, kind, pointer)
    for place, length, register in zip(places, kind.lengths, _unpack(builder, value), strict=True):
        full = register.type.count == length
        used = register if full else _shuffle(builder, register, register, range(length))
        builder.store(used, place, align=ALIGNMENT)


def _reader(vectors: int) -> Callable[[Any, Any, Any, Any], Any]:
    def typed(_: Any, axes: Any, array: Any, i: Any) -> Any:
        kind = _row_of(axes.count) if vectors == 3 else VectorType(axes.count)

        def codegen(context: Any, builder: Any, _: Any, args: Any) -> Any:
            _, value, i = args
            pointer = _pointer(context, builder, array, value, i, axes.count)
            return _read(builder, kind, pointer)

        return (kind(axes, array, types.int64), codegen) if _holds_doubles(array) else None

    return typed


def _writer(vectors: int, adds: bool) -> Callable[[Any, Any, Any, Any], Any]:
    def typed(_: Any, array: Any, i: Any, kind: Any) -> Any:
        if not _holds_doubles(array) or not isinstance(kind, VectorType):
            return None

        def codegen(context: Any, builder: Any, _: Any, args: Any) -> Any:
            where, i, new = args
            pointer = _pointer(context, builder, array, where, i, kind.size // vectors)
            if adds:
                old = _unpack(builder, _read(builder, kind, pointer))
                sums = zip(old, _unpack(builder, new), strict=True)
                new = _pack(builder, [builder.fadd(x, y) for x, y in sums])
            _write(builder, kind, pointer, new)
            return context.get_dummy_value()

        return types.void(array, types.int64, kind), codegen

    return typed


load, load_row = intrinsic(_reader(vectors=1)), intrinsic(_reader(vectors=3))
store = intrinsic(_writer(vectors=1, adds=False))
deposit = intrinsic(_writer(vectors=1, adds=True))
deposit_row = intrinsic(_writer(vectors=3, adds=True))


@intrinsic
def at(_: Any, array: Any, i: Any) -> tuple[Any, Codegen] | None:
    """Number i of an array."""

    def codegen(context: Any, builder: Any, _: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, array, args[0], args[1], 1))

    flat = isinstance(array, types.Array) and array.layout == "C"
    return (array.dtype(array, types.int64), codegen) if flat else None


@intrinsic
def diagonal(_: Any, axes: Any, array: Any, i: Any) -> tuple[Any, Codegen] | None:
    """Diagonal of square matrix i of an array."""
    d = axes.count
    kind = VectorType(d)

    def codegen(context: Any, builder: Any, _: Any, args: Any) -> Any:
        _, value, i = args
        pointer = _pointer(context, builder, array, value, i, d * d)
        register = ir.Constant(kind.registers[0], ir.Undefined)
        for k in range(d):
            number = builder.load(builder.gep(pointer, [ir.Constant(INDEX, k * (d + 1))]))
            register = builder.insert_element(register, number, _lane(k))
        return _pack(builder, [register])

    return (kind(axes, array, types.int64), codegen) if _holds_doubles(array) else None


# --- rows ---------------------------------------------------------------------------------------


def _zeros(vectors: int) -> Callable[[Any, Any], Any]:
    def typed(_: Any, axes: Any) -> Any:
        kind = _row_of(axes.count) if vectors == 3 else VectorType(axes.count)

        def codegen(_: Any, builder: Any, __: Any, ___: Any) -> Any:
            return _pack(builder, [ir.Constant(register, None) for register in kind.registers])

        return kind(axes), codegen

    return typed


zero, zero_row = intrinsic(_zeros(vectors=1)), intrinsic(_zeros(vectors=3))


@intrinsic
def part(_: Any, row: Any, a: Any) -> tuple[Any, Codegen] | None:
    """Vector a of a row; a is a literal."""
    if not isinstance(a, types.IntegerLiteral):
        return None
    d = row.size // 3

    def codegen(_: Any, builder: Any, __: Any, args: Any) -> Any:
        return _pack(builder, [_pick(builder, row, args[0], a.literal_value * d, d)])

    return VectorType(d)(row, a), codegen


@intrinsic
def join(_: Any, u: Any, v: Any, w: Any) -> tuple[Any, Codegen]:
    """Row of three vectors."""
    d = u.size
    kind = _row_of(d)

    def codegen(_: Any, builder: Any, __: Any, args: Any) -> Any:
        vectors = [_unpack(builder, arg)[0] for arg in args]
        registers = [ir.Constant(register, ir.Undefined) for register in kind.registers]
        for k in range(3 * d):
            number = builder.extract_element(vectors[k // d], _lane(k % d))
            n = k // kind.width
            registers[n] = builder.insert_element(registers[n], number, _lane(k % kind.width))
        return _pack(builder, registers)

    return kind(u, v, w), codegen


@intrinsic
def outer(_: Any, w: Any, u: Any) -> tuple[Any, Codegen]:
    """``(w_0 u, w_1 u, w_2 u)``."""
    d = u.size
    kind = _row_of(d)

    def codegen(_: Any, builder: Any, __: Any, args: Any) -> Any:
        weights = ir.Constant(ir.VectorType(DOUBLE, REGISTER), ir.Undefined)
        for a in range(3):
            weights = builder.insert_element(weights, builder.extract_value(args[0], a), _lane(a))
        vector = _unpack(builder, args[1])[0]
        registers = []
        for n, register in enumerate(kind.registers):
            lanes = [min(n * kind.width + k, 3 * d - 1) for k in range(register.count)]
            repeated = _shuffle(builder, weights, weights, [k // d for k in lanes])
            tiled = _shuffle(builder, vector, vector, [k % d for k in lanes])
            registers.append(builder.fmul(repeated, tiled))
        return _pack(builder, registers)

    return kind(w, u), codegen


@intrinsic
def contract(_: Any, w: Any, row: Any) -> tuple[Any, Codegen]:
    """``w_0 row_0 + w_1 row_1 + w_2 row_2``."""
    d = row.size // 3

    def codegen(_: Any, builder: Any, __: Any, args: Any) -> Any:
        terms = []
        for a in range(3):
            vector = _pick(builder, row, args[1], a * d, d)
            weight = _spread(builder, builder.extract_value(args[0], a), vector.type)
            terms.append(builder.fmul(weight, vector))
        return _pack(builder, [builder.fadd(builder.fadd(terms[0], terms[1]), terms[2])])

    return VectorType(d)(w, row), codegen
