"""Small vectors that live in registers, for compiled sweeps: one component for each dimension.

The sweeps of GIMP are vector algebra on two or three components at a time. Written as loops over
arrays they stay scalar; ``Vector(d)`` is the compiler's own vector of d doubles, so that one
instruction serves all components. In compiled functions

- ``load(axes, array, i)`` reads row i, ``store`` writes one and ``deposit`` adds to one. A row has
  ``len(axes)`` numbers; rows are counted through the whole C-contiguous array, whatever its
  shape, so that ``load(axes, F, d * p + k)`` is row k of the tensor of point p;
- ``+ - * /`` work by component, between vectors and between a vector and a number; ``u[k]`` is a
  component; ``floor``, ``minimum`` and ``maximum`` work by component too;
- ``at(array, i)`` reads number i of an array; ``store`` and ``deposit`` take numbers too.

Indices are neither checked nor counted from the end, which is what makes them fast.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

Vector = Any
"""What the type checker sees."""

Codegen = Callable[[Any, Any, Any, Any], Any]

DOUBLE = ir.DoubleType()
ALIGNMENT = 8
"""Rows begin at any double, not where a register would like it."""


class VectorType(types.Type):  # type: ignore[misc]
    """numba's type of a vector of ``size`` doubles."""

    def __init__(self, size: int) -> None:
        self.size = size
        super().__init__(name=f"Vector({size})")


@register_model(VectorType)
class VectorModel(models.PrimitiveModel):  # type: ignore[misc]
    """A vector is one LLVM value."""

    def __init__(self, manager: Any, kind: VectorType) -> None:
        super().__init__(manager, kind, ir.VectorType(DOUBLE, kind.size))


def _common(*kinds: Any) -> VectorType | None:
    """Vector type of an operation on vectors of one size and numbers, if it is one."""
    sizes = {kind.size for kind in kinds if isinstance(kind, VectorType)}
    numbers = [kind for kind in kinds if not isinstance(kind, VectorType)]
    if len(sizes) != 1 or any(kind != types.float64 for kind in numbers):
        return None
    return VectorType(sizes.pop())


def _spread(builder: Any, value: Any, size: int) -> Any:
    """Vector with a number in all components; a vector as it is."""
    if isinstance(value.type, ir.VectorType):
        return value
    vector = ir.Constant(ir.VectorType(DOUBLE, size), ir.Undefined)
    for k in range(size):
        vector = builder.insert_element(vector, value, ir.Constant(ir.IntType(32), k))
    return vector


class Arithmetic(AbstractTemplate):  # type: ignore[misc]
    """Typing of ``a op b`` where one side at least is a vector."""

    def generic(self, args: Any, _: Any) -> Any:
        """Signature for these arguments, or None."""
        kind = _common(*args)
        return kind and kind(*args)


def _define(op: object, instruction: str) -> None:
    """Teach numba an operator: one LLVM instruction."""

    def lower(_: Any, builder: Any, signature: Any, args: Any) -> Any:
        parts = (_spread(builder, arg, signature.return_type.size) for arg in args)
        return getattr(builder, instruction)(*parts)

    infer_global(op)(type(instruction, (Arithmetic,), {}))
    for a, b in ((VectorType, VectorType), (types.Float, VectorType), (VectorType, types.Float)):
        lower_builtin(op, a, b)(lower)


_define(operator.add, "fadd")
_define(operator.sub, "fsub")
_define(operator.mul, "fmul")
_define(operator.truediv, "fdiv")


@infer_global(operator.getitem)
class Component(AbstractTemplate):  # type: ignore[misc]
    """Typing of ``u[k]``."""

    def generic(self, args: Any, _: Any) -> Any:
        """Signature for these arguments, or None."""
        vector, index = args
        if isinstance(vector, VectorType) and isinstance(index, types.Integer):
            return types.float64(vector, index)
        return None


@lower_builtin(operator.getitem, VectorType, types.Integer)
def _component(_: Any, builder: Any, __: Any, args: Any) -> Any:
    return builder.extract_element(*args)


def _choose(comparison: str) -> Callable[[Any, Any, Any], Any]:
    def typed(_: Any, a: Any, b: Any) -> Any:
        kind = _common(a, b)

        def codegen(_: Any, builder: Any, signature: Any, args: Any) -> Any:
            x, y = (_spread(builder, arg, signature.return_type.size) for arg in args)
            return builder.select(builder.fcmp_ordered(comparison, x, y), x, y)

        return kind and (kind(a, b), codegen)

    return typed


minimum = intrinsic(_choose("<"))
maximum = intrinsic(_choose(">"))


@intrinsic
def floor(_: Any, u: Any) -> tuple[Any, Codegen] | None:
    """Largest integers not above the components."""

    def codegen(_: Any, builder: Any, __: Any, args: Any) -> Any:
        kind = args[0].type
        name = f"llvm.floor.v{kind.count}f64"
        function = get_or_insert_function(builder.module, ir.FunctionType(kind, [kind]), name)
        return builder.call(function, args)

    return (u(u), codegen) if isinstance(u, VectorType) else None


@intrinsic
def spread(_: Any, axes: Any, value: Any) -> tuple[Any, Codegen]:
    """Vector whose components are all ``value``."""
    kind = VectorType(axes.count)

    def codegen(_: Any, builder: Any, __: Any, args: Any) -> Any:
        return _spread(builder, args[1], kind.size)

    return kind(axes, types.float64), codegen


def _is_flat(array: Any) -> bool:
    return isinstance(array, types.Array) and array.layout == "C"


def _pointer(context: Any, builder: Any, array: Any, value: Any, i: Any, kind: Any) -> Any:
    """Where value i of a kind, a vector or a number, lies in an array."""
    size = kind.size if isinstance(kind, VectorType) else 1
    data = context.make_array(array)(context, builder, value).data
    first = builder.gep(data, [builder.mul(i, ir.Constant(i.type, size))])
    return builder.bitcast(first, context.get_value_type(kind).as_pointer())


def _read(context: Any, builder: Any, array: Any, value: Any, i: Any, kind: Any) -> Any:
    pointer = _pointer(context, builder, array, value, i, kind)
    return builder.load(pointer, align=min(ALIGNMENT, array.dtype.bitwidth // 8))


@intrinsic
def load(_: Any, axes: Any, array: Any, i: Any) -> tuple[Any, Codegen] | None:
    """Row i of an array, as a vector with ``len(axes)`` components."""
    kind = VectorType(axes.count)

    def codegen(context: Any, builder: Any, __: Any, args: Any) -> Any:
        return _read(context, builder, array, args[1], args[2], kind)

    flat = _is_flat(array) and array.dtype == types.float64
    return (kind(axes, array, types.int64), codegen) if flat else None


@intrinsic
def diagonal(_: Any, axes: Any, array: Any, i: Any) -> tuple[Any, Codegen] | None:
    """Diagonal of square matrix i of an array."""
    kind = VectorType(axes.count)

    def codegen(context: Any, builder: Any, __: Any, args: Any) -> Any:
        vector = ir.Constant(ir.VectorType(DOUBLE, kind.size), ir.Undefined)
        first = builder.mul(args[2], ir.Constant(args[2].type, kind.size**2))
        for k in range(kind.size):
            place = builder.add(first, ir.Constant(first.type, k * (kind.size + 1)))
            number = _read(context, builder, array, args[1], place, types.float64)
            vector = builder.insert_element(vector, number, ir.Constant(ir.IntType(32), k))
        return vector

    return (kind(axes, array, types.int64), codegen) if _is_flat(array) else None


@intrinsic
def at(_: Any, array: Any, i: Any) -> tuple[Any, Codegen] | None:
    """Number i of an array."""

    def codegen(context: Any, builder: Any, __: Any, args: Any) -> Any:
        return _read(context, builder, array, args[0], args[1], array.dtype)

    return (array.dtype(array, types.int64), codegen) if _is_flat(array) else None


def _write(adds: bool) -> Callable[[Any, Any, Any, Any], Any]:
    def typed(_: Any, array: Any, i: Any, value: Any) -> Any:
        if not _is_flat(array) or array.dtype != types.float64:
            return None

        def codegen(context: Any, builder: Any, __: Any, args: Any) -> Any:
            pointer = _pointer(context, builder, array, args[0], args[1], value)
            new = args[2]
            if adds:
                new = builder.fadd(builder.load(pointer, align=ALIGNMENT), new)
            builder.store(new, pointer, align=ALIGNMENT)
            return context.get_dummy_value()

        return types.void(array, types.int64, value), codegen

    return typed


store = intrinsic(_write(adds=False))
deposit = intrinsic(_write(adds=True))
