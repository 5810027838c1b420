"""Make message types of protobuf messages from the descriptors in an MCAP file."""

from typing import Any, Final

from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

from replay.logs.log_limits import LIMITS
from replay.logs.messages.broken_bytes import BrokenBytesError
from replay.logs.messages.decoding_libraries import DecodingLibrary, require_number_fits_int64
from replay.logs.messages.message_types import FieldType, ListOf, MessageType, RecordType, Scalar

_KINDS: Final = {
    FieldDescriptor.CPPTYPE_DOUBLE: "float64",
    FieldDescriptor.CPPTYPE_FLOAT: "float32",
    FieldDescriptor.CPPTYPE_INT32: "int32",
    FieldDescriptor.CPPTYPE_INT64: "int64",
    FieldDescriptor.CPPTYPE_UINT32: "uint32",
    FieldDescriptor.CPPTYPE_UINT64: "uint64",
    FieldDescriptor.CPPTYPE_BOOL: "bool",
    FieldDescriptor.CPPTYPE_ENUM: "int32",
    FieldDescriptor.CPPTYPE_STRING: "string",
}
_STAMPS: Final = ("google.protobuf.Timestamp", "google.protobuf.Duration")


def make_message_type_from_protobuf(name: str, descriptors: bytes) -> MessageType:
    """Make the message type `name` from a serialized `FileDescriptorSet`.

    Raises:
        BrokenBytesError: the descriptors are invalid, lack the type, or describe too many fields.
    """
    try:
        files = FileDescriptorSet.FromString(descriptors)
    except DecodeError as error:
        raise _make_unusable_descriptors_error(error) from error
    pool = _make_descriptor_pool(files)
    try:
        descriptor = pool.FindMessageTypeByName(name)
        read = GetMessageClass(descriptor).FromString
    except (KeyError, TypeError) as error:
        raise _make_unusable_descriptors_error(error) from error

    def decode_message(data: bytes) -> Any:
        try:
            return read(data)
        except DecodeError as error:
            raise BrokenBytesError(error) from error

    record = _DescriptorConverter().make_record_type(descriptor, ())
    return MessageType(record, ros1=False, decode=decode_message, library=PROTOBUF)


def _make_unusable_descriptors_error(reason: object) -> BrokenBytesError:
    return BrokenBytesError(f"its protobuf descriptors cannot be used: {reason}")


def _make_descriptor_pool(files: FileDescriptorSet) -> DescriptorPool:
    """Make a descriptor pool, to which each file is added after its dependencies."""
    pool = DescriptorPool()
    waiting = list(files.file)
    added: set[str] = set()
    while waiting:
        ready = [file for file in waiting if added.issuperset(file.dependency)]
        if not ready:
            raise _make_unusable_descriptors_error(
                f"{waiting[0].name} imports files that the descriptors do not include"
            )
        for file in ready:
            try:
                pool.Add(file)
            except TypeError as error:
                raise _make_unusable_descriptors_error(error) from error
            added.add(file.name)
        waiting = [file for file in waiting if file.name not in added]
    return pool


class _DescriptorConverter:
    """Converter of descriptors, with the types that they refer to, to record types."""

    def __init__(self) -> None:
        self._left = LIMITS.protobuf_fields

    def make_record_type(
        self, descriptor: Descriptor, enclosing_types: tuple[str, ...]
    ) -> RecordType:
        """Make a record type without maps, and without fields that contain the type itself."""
        within = (*enclosing_types, descriptor.full_name)
        fields = (
            (field.name, self._make_type_of_field(field, within)) for field in descriptor.fields
        )
        names = (
            (field.name, tuple((value.number, value.name) for value in field.enum_type.values))
            for field in descriptor.fields
            if field.enum_type is not None
        )
        return RecordType(
            descriptor.full_name,
            tuple((name, kind) for name, kind in fields if kind is not None),
            tuple(names),
        )

    def _make_type_of_field(
        self, field: FieldDescriptor, enclosing_types: tuple[str, ...]
    ) -> FieldType | None:
        self._left -= 1
        if self._left < 0:
            raise BrokenBytesError(f"it has more than {LIMITS.protobuf_fields} fields")
        inner = field.message_type
        if inner is None:
            is_bytes = field.type == FieldDescriptor.TYPE_BYTES
            if is_bytes and field.is_repeated:
                return None
            kind = ListOf(Scalar("uint8"), None) if is_bytes else Scalar(_KINDS[field.cpp_type])
        elif _is_time_or_duration(inner):
            kind = Scalar("stamp")
        elif inner.full_name in enclosing_types or inner.GetOptions().map_entry:
            return None
        else:
            kind = self.make_record_type(inner, enclosing_types)
        return ListOf(kind, None) if field.is_repeated and not isinstance(kind, ListOf) else kind


def _is_time_or_duration(descriptor: Descriptor) -> bool:
    """Whether a descriptor is a time or duration, by name and fields."""
    kinds = {field.name: field.cpp_type for field in descriptor.fields if not field.is_repeated}
    return (
        descriptor.full_name in _STAMPS
        and kinds.get("seconds") == FieldDescriptor.CPPTYPE_INT64
        and kinds.get("nanos") == FieldDescriptor.CPPTYPE_INT32
    )


def _get_message_member(message: Any, name: str) -> Any:
    field = message.DESCRIPTOR.fields_by_name[name]
    is_absent = field.has_presence and not message.HasField(name)
    if is_absent:
        return None
    try:
        return getattr(message, name)
    except UnicodeDecodeError as error:  # protobuf decodes a string only when it is accessed
        raise BrokenBytesError(error) from error


PROTOBUF: Final = DecodingLibrary(
    "protobuf",
    _get_message_member,
    lambda stamp: require_number_fits_int64(stamp.seconds * 10**9 + stamp.nanos),
)
