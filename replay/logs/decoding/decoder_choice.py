"""Choose the decoder of a type: columnar, or message by message if no plan can express it."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import polars as pl

from replay.logs.decoding.decode_program import compile_decode_program
from replay.logs.decoding.decoder import DecodedBatch, Decoder, Submit, make_frame_schema
from replay.logs.decoding.spans import NoPlanError
from replay.logs.decoding.wire import CDR
from replay.logs.messages.broken_bytes import BrokenBytesError
from replay.logs.messages.decoding_libraries import ROSBAGS, DecodingLibrary
from replay.logs.messages.message_fields import ALL, Field, PathStep
from replay.logs.messages.message_types import MessageType
from replay.logs.messages.raw_batch import RawBatch


class PerMessageDecoder:
    """Decoder of a type without a plan, which decodes by a library."""

    def __init__(self, kind: MessageType, fields: Sequence[Field]) -> None:
        self._kind = kind
        self._fields = tuple(fields)

    def begin_decoding(self, batch: RawBatch, submit: Submit) -> Callable[[], DecodedBatch]:  # noqa: ARG002 - objects need the lock
        """See `Decoder.begin_decoding`."""
        return lambda: self.decode(batch)

    def decode(self, batch: RawBatch) -> DecodedBatch:
        """Decode messages one by one; those that the library rejects have no row."""
        rows: list[tuple[Any, ...]] = []
        faults: list[str] = []
        times = batch.log_times.tolist()
        for time, data in zip(times, batch.iter_messages(), strict=True):
            try:
                rows.append((time, *self._decode_values(data)))
            except BrokenBytesError as error:
                faults.append(str(error))
        frame = pl.DataFrame(rows, schema=make_frame_schema(self._fields), orient="row")
        return DecodedBatch(frame, len(faults), faults[0] if faults else "")

    def _decode_values(self, data: bytes) -> tuple[Any, ...]:
        message = self._kind.decode(data)
        library = self._kind.library
        stamp = None
        if self._kind.record.has_header:
            stamp = library.stamp_ns(library.get(library.get(message, "header"), "stamp"))
        return (
            stamp,
            *(_extract_value_at_path(library, message, f.steps, f.kind) for f in self._fields),
        )


def _extract_value_at_path(
    library: DecodingLibrary, message: Any, steps: Sequence[PathStep], value_type: str
) -> Any:
    for number, step in enumerate(steps, 1):
        value = library.get(message, step.name)
        if value is None:
            return None
        if step.element == ALL:
            return [
                _extract_value_at_path(library, element, steps[number:], value_type)
                for element in library.elements(value)
            ]
        if step.element is not None:
            is_by_name = isinstance(step.element, str)
            names = library.elements(library.get(message, "name")) if is_by_name else ()
            value = _select_list_element(names, library.elements(value), step.element)
        if value is None:
            return None
        message = value
    return (
        library.stamp_ns(message) if value_type == "stamp" else library.convert(message, value_type)
    )


def _select_list_element(
    element_names: Sequence[Any], values: Sequence[Any], index_or_name: int | str
) -> Any:
    if isinstance(index_or_name, int):
        number = index_or_name
    elif index_or_name in element_names:
        number = list(element_names).index(index_or_name)
    else:
        return None
    return values[number] if number < len(values) else None


def choose_decoder_name_of_type(message_type: MessageType) -> str:
    """Name the decoder of a type: `columnar`, or the library that decodes message by message."""
    if message_type.library is ROSBAGS:
        try:
            compile_decode_program(message_type.record, {}, CDR)
        except NoPlanError:
            return ROSBAGS.name
        return "columnar"
    return message_type.library.name


def make_decoder_of_fields(message_type: MessageType, fields: Sequence[Field]) -> Decoder:
    """Make the columnar decoder, or a library's if no plan can express the type."""
    # numba is slow to import, and a log can be described without it
    if message_type.library is ROSBAGS:
        from replay.logs.decoding.decode_plan import DecodePlan

        with suppress(NoPlanError):
            return DecodePlan(message_type.record, ros1=message_type.ros1, fields=fields)

    return PerMessageDecoder(message_type, fields)
