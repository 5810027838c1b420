"""`payscope keys`: manage public keys whose owners the user knows."""

import datetime as dt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from recordings.signatures.signing import PublicKey

app = typer.Typer(no_args_is_help=True)
_DAY = ["%Y-%m-%d"]


@app.command("list")
def list_keys(
    as_json: Annotated[bool, typer.Option("--json", help="Print the keys as JSON.")] = False,
) -> None:
    """List the keys of the keyring, and where it is; PAYSCOPE_KEYRING names another file."""
    from recordings.signatures.keyring import load_keyring
    from replay.commands.print_tables import (
        make_plain_table,
        make_stdout_console,
        print_json,
        print_line,
        print_table_uncut,
    )

    keyring = load_keyring()
    rows = [{"key_id": each.public_key.key_id, **each.model_dump()} for each in keyring.keys]
    if as_json:
        print_json(rows)
        return
    screen = make_stdout_console()
    table = make_plain_table("key", "owner", "valid from", "valid to", "revoked")
    for row in rows:
        days = (row["valid_from"], row["valid_to"], row["revoked"])
        table.add_row(f"{row['key_id'][:12]}…", row["owner"], *(str(d or "–") for d in days))
    print_table_uncut(screen, table)
    print_line(screen, f"keyring: {keyring.path}")


@app.command()
def add(
    key: Annotated[str, typer.Argument(help="Public Ed25519 key: a PEM file, or its base64.")],
    owner: Annotated[str, typer.Option(help="Owner of the key, whom you have verified.")],
    valid_from: Annotated[
        dt.datetime | None, typer.Option(formats=_DAY, help="First day of valid signatures.")
    ] = None,
    valid_to: Annotated[
        dt.datetime | None, typer.Option(formats=_DAY, help="Last day of valid signatures.")
    ] = None,
) -> None:
    """Add a public key to the keyring."""
    from estimators.errors import EvidenceError
    from recordings.signatures.keyring import add_key_to_keyring, load_keyring, validate_known_key

    public = _read_public_key_or_key_file(key)
    if not owner.strip():
        raise EvidenceError("--owner is empty; give the name of the key's owner")
    if valid_from and valid_to and valid_to < valid_from:
        raise EvidenceError("--valid-to is before --valid-from; correct one of them")
    keyring = load_keyring()
    fields = {
        "key": public.base64_text,
        "owner": owner.strip(),
        "valid_from": None if valid_from is None else valid_from.date(),
        "valid_to": None if valid_to is None else valid_to.date(),
    }
    known = validate_known_key(fields, f"{keyring.path}: key {public.key_id[:12]}…")
    keyring = add_key_to_keyring(keyring, known)
    typer.echo(f"{keyring.path}: key {public.key_id[:12]}… of {known.owner} added")


@app.command()
def revoke(
    key: Annotated[str, typer.Argument(help="First digits of the key's id, or the key.")],
    day: Annotated[
        dt.datetime | None,
        typer.Option(formats=_DAY, help="Day of the revocation; today by default."),
    ] = None,
    reason: Annotated[
        str, typer.Option("--because", help="Reason of the revocation, such as a lost disk.")
    ] = "",
) -> None:
    """Revoke a key: its signatures no longer count, except those that a time stamp proves older."""
    from recordings.signatures.keyring import load_keyring, revoke_key_in_keyring

    is_id = all(digit in "0123456789abcdef" for digit in key) and key != ""
    key_id = key if is_id else _read_public_key_or_key_file(key).key_id
    since = dt.datetime.now(dt.UTC).date() if day is None else day.date()
    keyring = revoke_key_in_keyring(load_keyring(), key_id, since, reason)
    typer.echo(f"{keyring.path}: key {key_id[:12]}… revoked on {since}")


def _read_public_key_or_key_file(key_text_or_path: str) -> "PublicKey":
    from estimators.errors import EvidenceError
    from recordings.signatures.signing import PublicKey, read_public_key_file

    if Path(key_text_or_path).exists():
        return read_public_key_file(Path(key_text_or_path))
    try:
        return PublicKey.from_base64_text(key_text_or_path)
    except EvidenceError as fault:
        raise EvidenceError(
            f"{key_text_or_path}: no such file, and not a key in base64 ({fault}); "
            "give a PEM file with a public key, or the key in base64"
        ) from None
