"""Encodings of messages that decoders need to distinguish."""

from dataclasses import dataclass
from typing import Final

#: Size of each type of number in bytes.
WIDTHS: Final = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}


@dataclass(frozen=True, slots=True)
class WireEncoding:
    """Encoding of a message's fields in bytes.

    `cdr` has an encapsulation of 4 bytes, from whose end alignment counts, ends strings in a NUL
    that their length counts, may pad the end of a message to 4 bytes, and gives an empty message
    one byte. ROS 1 has none of these.
    """

    cdr: bool
    #: numbers are aligned to their own size, but to no more than this
    max_alignment: int
    #: lists of anything but numbers are preceded by their size in bytes (XTypes 1.3, 7.4.3.5)
    delimited_lists: bool = False

    @property
    def encapsulation_size_bytes(self) -> int:
        """Number of bytes of the encapsulation."""
        return 4 if self.cdr else 0

    @property
    def length_alignment(self) -> int:
        """Alignment of the lengths of strings and lists."""
        return min(4, self.max_alignment)


ROS1: Final = WireEncoding(cdr=False, max_alignment=1)
CDR: Final = WireEncoding(cdr=True, max_alignment=8)
XCDR2: Final = WireEncoding(cdr=True, max_alignment=4, delimited_lists=True)
#: Encoding by the second byte of the encapsulation (the first is 0), whose lowest bit means
#: little-endian.
#: DDSI-RTPS 2.5 numbers XCDR2 from 6, XTypes 1.3 from 16.
ENCAPSULATIONS: Final = {0: CDR, 1: CDR, 6: XCDR2, 7: XCDR2, 16: XCDR2, 17: XCDR2}
#: Encodings whose members have a length or a number, which the walk does not support.
REFUSED: Final = {
    **dict.fromkeys((2, 3), "parameter list (PL_CDR)"),
    **dict.fromkeys((8, 9, 20, 21), "delimited XCDR2 (D_CDR2)"),
    **dict.fromkeys((10, 11, 18, 19), "parameter list XCDR2 (PL_CDR2)"),
}
