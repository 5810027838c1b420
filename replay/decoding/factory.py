"""Which decoder a type gets: the columnar one, or a library's."""

from collections.abc import Sequence

from replay.decoding.decoder import Decoder
from replay.decoding.program import compile_program
from replay.decoding.spans import NoPlanError
from replay.decoding.wire import CDR
from replay.messages.fields import Field
from replay.messages.library import ROSBAGS
from replay.messages.types import MessageType


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
        from replay.decoding.plan import Plan

        return Plan(kind.record, ros1=kind.ros1, fields=fields)
    from replay.decoding.fallback import MessageByMessage

    return MessageByMessage(kind, fields)
