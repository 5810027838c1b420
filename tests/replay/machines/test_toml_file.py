"""Machine files as editors save them."""

from pathlib import Path

from replay import load_machine
from tests.replay.sledge import MACHINE


def test_a_byte_order_mark_is_no_part_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(MACHINE, encoding="utf-8-sig")
    assert load_machine(path).machine.name == "sledge"
