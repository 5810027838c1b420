"""Which decoder a type gets: the columnar one, or a library's."""

from collections.abc import Sequence

from replay.logs.decoding.decode_program import compile_program
from replay.logs.decoding.decoder import Decoder
from replay.logs.decoding.spans import NoPlanError
from replay.logs.decoding.wire import CDR
from replay.logs.messages.decoding_libraries import ROSBAGS
from replay.logs.messages.message_fields import Field
from replay.logs.messages.message_types import MessageType


def decoder_name(kind: MessageType) -> str:
    """Name the decoder of a type: `columnar`, or the library that decodes message by message."""
    if kind.library is ROSBAGS:
        try:
            compile_program(kind.record, {}, CDR)
        except NoPlanError:
            return ROSBAGS.name
        return "columnar"
    return kind.library.name


def make_decoder(kind: MessageType, fields: Sequence[Field]) -> Decoder:
    """Make the columnar decoder, or a library's for a type that it cannot express."""
    # numba is slow to import, and a log can be described without it
    if decoder_name(kind) == "columnar":
        from replay.logs.decoding.decode_plan import Plan

        return Plan(kind.record, ros1=kind.ros1, fields=fields)
    from replay.logs.decoding.per_message import PerMessageDecoder

    return PerMessageDecoder(kind, fields)
