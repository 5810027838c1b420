"""Which decoder a type gets, and what both decoders give."""

from replay.readers.message_types import Record, Scalar

COUNTER = Record("t/msg/Counter", (("count", Scalar("uint8")),))


def in_turn(stored: list[bytes]) -> RawBatch:
    (batch,) = join_messages(StoredMessage(k, data) for k, data in enumerate(stored))
    return batch
