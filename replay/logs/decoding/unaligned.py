"""Load numbers at any byte of an array, in compiled code.

Indexing supports aligned numbers only, checks for negative indices, and counts references to shared
slices: over a million messages, this costs more than loading the numbers. As with indexing in
compiled code, bounds are not checked: the caller must check them. `tests/replay/test_edges.py` puts
damaged bytes at the edge of memory to test it. A non-contiguous array is rejected when the caller
is compiled.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir  # installed with numba
from numba.core import cgutils, types
from numba.extending import intrinsic

from estimators.arrays import Bytes


def _are_byte_arrays_of_numba(*array_types: Any) -> bool:
    return all(
        isinstance(each, types.Array) and each.dtype == types.uint8 and each.layout == "C"
        for each in array_types
    )


def _emit_address_of_array_item(
    context: Any, builder: Any, array_type: Any, array: Any, offset: Any
) -> Any:
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [offset])


def _make_load_intrinsic(number_type: Any) -> Any:
    def type_load(_: Any, data: Any, at: Any) -> tuple[Any, Any] | None:
        def generate_load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            address = _emit_address_of_array_item(context, builder, signature.args[0], *arguments)
            pointer = builder.bitcast(address, context.get_data_type(number_type).as_pointer())
            return context.cast(builder, builder.load(pointer, align=1), number_type, types.int64)

        return (types.int64(data, at), generate_load) if _are_byte_arrays_of_numba(data) else None

    return type_load


def _emit_copy_of_bytes(
    _typing_context: Any, data: Any, offset: Any, target: Any, target_offset: Any, size: Any
) -> tuple[Any, Any] | None:
    def generate_copy(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source = _emit_address_of_array_item(context, builder, signature.args[0], *arguments[:2])
        sink = _emit_address_of_array_item(context, builder, signature.args[2], *arguments[2:4])
        cgutils.raw_memcpy(builder, sink, source, arguments[4], 1)
        return context.get_dummy_value()

    signature = types.void(data, offset, target, target_offset, size)
    return (signature, generate_copy) if _are_byte_arrays_of_numba(data, target) else None


def _emit_float_to_double_conversion(_typing_context: Any, bits: Any) -> tuple[Any, Any]:
    def generate_float_to_double_conversion(
        context: Any, builder: Any, _signature: Any, arguments: Any
    ) -> Any:
        word = builder.trunc(arguments[0], context.get_data_type(types.uint32))
        single = builder.bitcast(word, context.get_data_type(types.float32))
        double = builder.fpext(single, context.get_data_type(types.float64))
        return builder.bitcast(double, context.get_data_type(types.int64))

    return types.int64(bits), generate_float_to_double_conversion


def _prefetch_cache_line(_typing_context: Any, data: Any, offset: Any) -> tuple[Any, Any] | None:
    def generate_prefetch(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = _emit_address_of_array_item(context, builder, signature.args[0], *arguments)
        word = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [address.type, word, word, word])
        prefetch = builder.module.declare_intrinsic("llvm.prefetch", [address.type], kind)
        # for reading, into the nearest cache, as data
        builder.call(prefetch, [address, word(0), word(3), word(1)])
        return context.get_dummy_value()

    return (
        (types.void(data, offset), generate_prefetch) if _are_byte_arrays_of_numba(data) else None
    )


#: (data, at) -> unsigned integer of 2 and of 4 little-endian bytes, and signed integer of 8
load16: Callable[[Bytes, int], int] = cast("Any", intrinsic(_make_load_intrinsic(types.uint16)))
load32: Callable[[Bytes, int], int] = cast("Any", intrinsic(_make_load_intrinsic(types.uint32)))
load64: Callable[[Bytes, int], int] = cast("Any", intrinsic(_make_load_intrinsic(types.int64)))
#: (data, at, target, to, size): copy `size` bytes
copy: Callable[[Bytes, int, Bytes, int, int], None] = cast("Any", intrinsic(_emit_copy_of_bytes))
#: (bits of a 32-bit float) -> bits of the equal 64-bit float
widened: Callable[[int], int] = cast("Any", intrinsic(_emit_float_to_double_conversion))
#: (data, at): prefetch that byte into the processor's cache
fetch: Callable[[Bytes, int], None] = cast("Any", intrinsic(_prefetch_cache_line))
