"""Tables of a fleet, and the columns that they keep of every recording.

Every row begins with the key of its result, the machine, the day and the Unix time of the first
sample. A table that keeps a frame has the name of the frame.
"""

from collections.abc import Mapping
from typing import Final

import polars as pl

from analysis.model.run_record import Run
from analysis.model.schema import FRAMES, Column, Frame, make_float_column
from analysis.model.verdict import Verdict

#: Frames of a run that are kept as they are.
KEPT: Final = ("loads", "segments", "cycles", "findings")


#: Columns that identify the result of a row.
OF_RESULT: Final = (
    Column("key", pl.String, "1", "of the result: log, machine, settings and version"),
    Column("machine", pl.String, "1", "name by the fleet file"),
    Column("day", pl.String, "1", "day of the first sample where the machine is, or undated"),
    Column("t0_unix_ns", pl.Int64, "ns", "unix time of the first sample"),
)
RESULTS: Final = Frame(
    "results",
    "a row for each recording: its results and inputs",
    (
        Column("source", pl.String, "1", "where the log was"),
        Column("log_sha256", pl.String, "1", "digests of its files, separated by commas"),
        Column("size_bytes", pl.Int64, "B", "size of its files"),
        Column("stamp", pl.String, "1", "last change of the log, as its storage reports it"),
        Column("basis", pl.String, "1", "digest of machine, settings, calibration and versions"),
        Column("payscope", pl.String, "1", "version that made it"),
        Column("status", pl.String, "1", "replayed, or refused"),
        Column("reason", pl.String, "1", "why it was refused (empty where not)"),
        Column("can_weigh", pl.Boolean, "1", "whether a mass may be given"),
        Column("failed_checks", pl.String, "1", "checks that failed, separated by commas"),
        Column("losses", pl.Int64, "1", "losses of the log"),
        Column("first_loss", pl.String, "1", "the first of them, in a sentence"),
        make_float_column("duration_s", "s", "from the first sample to the last"),
        make_float_column("gap_s", "s", "part of duration_s without a recording"),
        make_float_column(
            "idle_s", "s", "part of duration_s in standstills of more than half a minute"
        ),
        make_float_column("longest_gap_at_s", "s", "where the longest gap begins (null: no gap)"),
        make_float_column("accepted_1", "1", "share of the time that the gate accepted"),
        Column("cycles", pl.Int64, "1", "cycles that were seen"),
        Column("cycles_counted", pl.Int64, "1", "cycles in the sum"),
        Column(
            "cycles_without_mass", pl.Int64, "1", "cycles without a start that determines the mass"
        ),
        make_float_column("payload_kg", "kg", "sum of payloads"),
        make_float_column("payload_u_random_kg", "kg", "its random standard uncertainty"),
        make_float_column("payload_u_common_kg", "kg", "its common standard uncertainty"),
        make_float_column("payload_u_kg", "kg", "standard uncertainty, random and common"),
        Column("scale_from", pl.String, "1", "what determines the scale of payloads"),
        Column(
            "scale_unknown",
            pl.String,
            "1",
            "sources of payload scale error without a stated uncertainty",
        ),
        make_float_column("gain_1", "1", "empty machine in the log over that of the machine file"),
        make_float_column("gain_u_1", "1", "its standard uncertainty"),
        make_float_column("lost_cycles", "1", "cycles expected where nothing was recorded"),
        make_float_column("lost_kg", "kg", "payload that they would have carried"),
        make_float_column("friction_x_N_s_m", "N·s/m", "viscous friction by the joint fit"),
        make_float_column("friction_x_std_N_s_m", "N·s/m", "its standard deviation"),
        Column("calibration", pl.String, "1", "id of the evidence in use (empty: none)"),
        Column(
            "not_calibrated_for", pl.String, "1", "what in the log contradicts it (empty: nothing)"
        ),
        Column("results_fingerprint", pl.String, "1", "digest of all frames of the replay"),
        Column("made_unix_ns", pl.Int64, "ns", "unix time of the replay"),
    ),
)
GATE_SHARES: Final = Frame(
    "gate_shares",
    "a row for each reason of the gate: its share of the recorded time",
    (
        Column("reason", pl.String, "1", "accepted, or why not"),
        make_float_column("share_1", "1", "share of the time"),
    ),
)
QUALITY: Final = Frame(
    "quality",
    "a row for each topic: how regularly it was recorded",
    (
        Column("topic", pl.String, "1", "its name"),
        Column("messages", pl.Int64, "1", "messages that were read"),
        make_float_column("rate_hz", "Hz", "one over the median period"),
        make_float_column("longest_s", "s", "longest time between two messages"),
        make_float_column("late_1", "1", "share of messages more than one and a half periods late"),
    ),
)
#: All tables. `results` is written last, so that a row of it means that the result is complete.
TABLES: Final[Mapping[str, Frame]] = {
    **{name: FRAMES[name] for name in KEPT},
    "gate_shares": GATE_SHARES,
    "quality": QUALITY,
    "results": RESULTS,
}


def make_table_schema(table_name: str) -> pl.Schema:
    """Columns of a table: key, machine, day and start, then those of the frame."""
    columns = (*OF_RESULT, *TABLES[table_name].columns)
    return pl.Schema({column.name: choose_parquet_dtype(column) for column in columns})


def choose_parquet_dtype(column: Column) -> pl.DataType:
    """Column type in Parquet; enumerations are stored as text, which every reader supports."""
    dtype = column.dtype() if isinstance(column.dtype, type) else column.dtype
    return pl.String() if isinstance(dtype, pl.Enum) else dtype


def convert_frame_to_table_rows(
    table_name: str, frame: pl.DataFrame, key_values: Mapping[str, object]
) -> pl.DataFrame:
    """Convert rows of a frame to rows of its table.

    Args:
        table_name: name of the frame and the table.
        frame: frame with some or all of its columns; missing ones become null.
        key_values: values of key, machine, day and t0_unix_ns.
    """
    schema = make_table_schema(table_name)
    given = frame.with_columns(**{each: pl.lit(value) for each, value in key_values.items()})
    return given.select(
        (pl.col(each) if each in given.columns else pl.lit(None)).cast(dtype).alias(each)
        for each, dtype in schema.items()
    )


def make_tables_of_run(
    run: Run, other_frames: Mapping[str, pl.DataFrame]
) -> dict[str, pl.DataFrame]:
    """All tables of a run except `results`.

    Args:
        run: a replay.
        other_frames: frames `gate_shares` and `quality`.
    """
    nothing = pl.DataFrame()
    return {
        name: other_frames[name] if name in other_frames else run.frames.get(name, nothing)
        for name in TABLES
        if name != "results"
    }


def make_result_row(run: Run) -> dict[str, object]:
    """Columns of `results` that the run itself determines."""
    about, frames = run.provenance, run.frames
    verdict = Verdict.from_frame(frames["verdict"])
    shift = frames["shift"].row(0, named=True)
    load = frames["loads"].row(0, named=True) if frames["loads"].height else {}
    gate = frames["gate"]
    same = ("duration_s", "gap_s", "idle_s", "cycles", "cycles_counted", "cycles_without_mass")
    sums = ("payload_kg", "payload_u_random_kg", "payload_u_common_kg", "payload_u_kg")
    scale = ("scale_from", "scale_unknown", "gain_1", "gain_u_1")
    return {
        "status": "replayed",
        "reason": "",
        "can_weigh": verdict.can_weigh,
        "failed_checks": ", ".join(
            check.check
            for check in verdict.checks
            if check.passed is False and check.about == "mass"
        ),
        "losses": len(about.losses),
        "first_loss": str(about.losses[0]) if about.losses else "",
        **{name: shift[name] for name in (*same, *sums, *scale, "lost_cycles", "lost_kg")},
        "accepted_1": gate["accepted_x"].mean() if gate.height else None,
        "friction_x_N_s_m": load.get("friction_x_N_s_m"),
        "friction_x_std_N_s_m": load.get("friction_x_std_N_s_m"),
        "results_fingerprint": about.fingerprint.results if about.fingerprint else "",
    }
