"""Definitions that ask for more than a message can be: refused at once, in a line."""

import pytest

from replay.logs.message_definitions import DefinitionError, make_message_type_of_connection
from replay.logs.messages.message_types import ListOf, RecordType, Scalar
from replay.logs.storage.container import Connection

RULE = "=" * 80


def compiled(text: str, *, ros1: bool = False) -> RecordType:
    encoding = ("ros1", "ros1msg") if ros1 else ("cdr", "ros2msg")
    return make_message_type_of_connection(
        Connection(0, "/t", "t/msg/T0", encoding[0], text, encoding[1])
    ).record


def chain(field: str, levels: int) -> str:
    parts = [field.format(f"t/T{k + 1}") for k in range(levels)]
    later = (f"{RULE}\nMSG: t/T{k}\n{part}" for k, part in enumerate([*parts, "uint8 x\n"]) if k)
    return parts[0] + "".join(later)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (chain("{0} a\n{0} b\n", 40), "more than 20000 fields"),
        (chain("{0} a\n", 100), "deeper than 64 levels"),
        (chain("{0}[1000] a\n", 4), "array of 1000 elements"),
        ("string[1000000000] a\n", "array of 1000000000 elements"),
        ("uint8[1000000000000000000000] a\n", "array of 1000000000000000000000 elements"),
        ("t/T0 a\n", "contains itself"),
    ],
)
def test_a_definition_that_asks_for_too_much_is_refused(text: str, fault: str) -> None:
    with pytest.raises(DefinitionError, match=fault) as caught:
        compiled(text)
    assert "\n" not in str(caught.value)


def test_a_byte_is_signed_in_ros1_and_an_octet_in_ros2() -> None:
    text = "byte level\nbyte[] levels\n"
    for ros1, kind in ((True, "int8"), (False, "uint8")):
        byte = Scalar(kind)
        assert compiled(text, ros1=ros1).fields == (("level", byte), ("levels", ListOf(byte, None)))


def test_a_time_is_a_stamp_and_nothing_else() -> None:
    time = f"builtin_interfaces/Time t\n{RULE}\nMSG: builtin_interfaces/Time\n"
    assert compiled(f"{time}int32 sec\nuint32 nanosec\n").fields == (("t", Scalar("stamp")),)
    with pytest.raises(DefinitionError, match="already present with different definition"):
        compiled(f"{time}float64 sec\n")
