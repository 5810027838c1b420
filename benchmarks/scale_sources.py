"""Tonnes of shifts whose scale comes from a ticket, from evidence, from both, or from neither.

    python -P benchmarks/scale_sources.py [--shifts 40] [--first 0] [--hours 2] [--clean]
                                          [--json FILE]
    python -P benchmarks/scale_sources.py --wrong-scale [--shifts 40] [--json FILE]

Each shift has a machine, a ground, instruments and habits of its own (`benchmarks/independent`),
with loads of 10 to 30 % of the machine. Its machine file states the gain of the force to 1 % and
the wheel radius to 0.5 %; the weighbridge ticket is of the empty machine of the day, with a
standard uncertainty of 0.3 %. Evidence is a campaign of one day on level ground: six loads, nine
starts each. Two replays make four arms: a replay has its payloads on the scale of the log as well
(`own_...`), and evidence calibrates those.

With `--wrong-scale` torque, radius or share are wrong (10, 5, 10 %), and the file states no
uncertainty of them: a ticket is all there is.

With `--clean` they drive on hard level ground with good instruments: what the scale alone does.
`--json` keeps a line a shift as it comes and goes on where it ended.
"""

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import polars as pl
import typer

from analysis.calibration.line.calibration import Calibration
from analysis.calibration.line.shared_errors import SharedErrors
from analysis.calibration.use.learnt_priors import describe_contradicted_learnt_priors
from analysis.cycles.calibrated_payloads import calibrate_cycles
from analysis.cycles.haul_spillage import subtract_spillage_from_payload_columns
from analysis.cycles.shift_totals import recompute_shift_totals
from analysis.model.machine import Machine
from analysis.model.run_record import Run
from benchmarks.independent.machine_file import Known
from benchmarks.independent.shift_logs import ShiftLog, ShiftPlan, shift_log, write_shift_log
from benchmarks.independent_campaigns import Drawn, Way, calibrated, machine_as_calibrated
from benchmarks.independent_shifts import match_dumps
from benchmarks.kept_trials import run_seeds
from benchmarks.page import markdown
from replay import load_machine, open_log, run

K: Final = 2.0
#: Standard uncertainty of the ticket over the empty mass, and mean loads over it.
TICKET_U_1: Final = 0.003
LOAD_SHARE: Final = (0.10, 0.30)
#: Loads of the campaign over the machine: up to the heaviest bucket of a shift.
CAMPAIGN_LOADS_1: Final = (0.0, 0.09, 0.18, 0.27, 0.36, 0.45)
WRONG: Final = (
    *(ShiftPlan(force_1=1.1), ShiftPlan(force_1=0.9), ShiftPlan(radius_1=1.05)),
    *(ShiftPlan(radius_1=0.95), ShiftPlan(share_1=1.1), ShiftPlan(share_1=0.9)),
)
NEITHER, TICKET, EVIDENCE, BOTH = "neither", "ticket", "evidence", "both"
_CYCLE: Final = (
    *("cycle", "dump_t_ns", "payload_kg", "payload_u_kg", "payload_u_random_kg"),
    *("payload_u_shared_kg", "counted", "withheld_for", "scale_from"),
)
_NS: Final = 1e9


@dataclass(frozen=True)
class ScaledShift:
    """A shift, by arm.

    Attributes:
        seed: of all that is drawn.
        hours: that it lasts.
        true_kg: what each cycle dumped,
        dump_s: and when, Unix time.
        habits: of the driver.
        wrong: what is wrong with the scale.
        shift: the frame `shift`, by arm.
        cycles: rows of `cycles`, by arm.
        begin_s: Unix time of the log's begin.
        why: why there is no evidence, or what contradicts it.
        seconds: of each replay.
    """

    seed: int
    hours: float
    true_kg: list[float]
    dump_s: list[float]
    habits: list[str]
    wrong: str
    shift: dict[str, dict[str, Any]]
    cycles: dict[str, list[dict[str, Any]]]
    begin_s: float
    why: str
    seconds: list[float]

    def pairs(self, arm: str) -> list[tuple[dict[str, Any], float]]:
        """Counted cycles that are true ones, with what these dumped, in kg."""
        rows = [row for row in self.cycles[arm] if row["counted"] and row["dump_t_ns"] is not None]
        mine_s = [self.begin_s + row["dump_t_ns"] / _NS for row in rows]
        return [(rows[a], self.true_kg[b]) for a, b in match_dumps(mine_s, self.dump_s)]

    def matched(self, arm: str) -> tuple[float, float, float, float]:
        """Sum of counted payloads whose cycle is known, its true value, u of it, and common part.

        What is missed or too many does not count here: it is no question of the scale.
        """
        pairs = self.pairs(arm)
        said = [row for row, _ in pairs]
        common_kg = sum(row["payload_u_shared_kg"] for row in said)
        random_kg = float(np.linalg.norm([row["payload_u_random_kg"] for row in said]))
        return (
            sum(row["payload_kg"] for row in said),
            sum(true_kg for _, true_kg in pairs),
            float(np.hypot(common_kg, random_kg)),
            float(common_kg),
        )

    def total(self, arm: str) -> tuple[float, float]:
        """All that was dumped, and its standard uncertainty; NaN where nothing is counted."""
        row = self.shift[arm]
        if not row["cycles_counted"]:
            return float("nan"), float("nan")
        return row["total_kg"], row["total_u_kg"]


def _on_own_scale(cycles: pl.DataFrame) -> pl.DataFrame:
    """The cycles without their ticket: payloads and uncertainties on the scale of the log."""
    own = [f"payload_{part}kg" for part in ("", "u_random_")]
    unspilled = cycles.with_columns(
        *((pl.col(name) / pl.col("scale_1")).alias(name) for name in own),
        pl.col("own_u_common_kg").alias("payload_u_common_kg"),
        pl.col("own_u_shared_kg").alias("payload_u_shared_kg"),
        scale_1=pl.when(pl.col("scale_1").is_not_null()).then(1.0),
        scale_from=pl.lit(None, pl.String).cast(cycles.schema["scale_from"]),
    ).with_columns(
        payload_u_kg=(
            pl.col("payload_u_random_kg") ** 2 + pl.col("payload_u_common_kg") ** 2
        ).sqrt()
    )
    return subtract_spillage_from_payload_columns(unspilled)


def _campaign_of(log: ShiftLog, seed: int) -> tuple[Calibration, Machine] | str:
    """Evidence of the shift's machine, from one day on level ground."""
    plant = log.plant._replace(slope_rad=0.0, hills_rad=0.0, rolling_far_1=log.plant.rolling_1)
    known = Known(
        log.known.empty_mass_kg,
        TICKET_U_1 * plant.mass_kg,
        log.known.force_gain_u,
        log.known.radius_u_m,
    )
    way = Way((0.6, 1.0), alternates=True, start_s=2.5)
    drawn = Drawn(plant, log.seen, way, log.stated, known)
    return calibrated(drawn, np.random.default_rng([seed, 26_001]), CAMPAIGN_LOADS_1)


def scaled(seed: int, hours: float, *, clean: bool, wrong_scale: bool) -> ScaledShift:
    """Make a shift, and its tonnes of each arm."""
    wrong = WRONG[seed % len(WRONG)] if wrong_scale else ShiftPlan()
    log = shift_log(seed, wrong._replace(hours=hours, load_share=LOAD_SHARE, clean=clean))
    empty_kg = log.plant.mass_kg
    dice = np.random.default_rng([seed, 26_002])
    ticket_kg = empty_kg * float(dice.normal(1.0, TICKET_U_1))
    known = log.known._replace(empty_mass_kg=ticket_kg, empty_mass_u_kg=TICKET_U_1 * ticket_kg)
    if wrong_scale:
        known = known._replace(force_gain_u=None, radius_u_m=None)
    log = log._replace(known=known)
    shift: dict[str, dict[str, Any]] = {}
    cycles: dict[str, list[dict[str, Any]]] = {}
    seconds: list[float] = []
    why, begin_s = "", 0.0

    def count(arm: str, frames: dict[str, pl.DataFrame], found: pl.DataFrame) -> None:
        cycles[arm] = found.select(_CYCLE).to_dicts()
        shift[arm] = recompute_shift_totals(frames["shift"], found).row(0, named=True)

    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        paths, stated = write_shift_log(log, Path(name))
        log.files.clear()
        logs = [stack.enter_context(open_log(path)) for path in paths]
        machine = load_machine(stated)

        def replayed(by: Machine) -> Run:
            began = time.process_time()
            made = run(logs, by)
            seconds.append(time.process_time() - began)
            return made

        made = replayed(machine)
        begin_s = made.provenance.t0_unix_ns / _NS
        count(TICKET, made.frames, made.frames["cycles"])
        count(NEITHER, made.frames, _on_own_scale(made.frames["cycles"]))
        evidence = "" if wrong_scale else _campaign_of(log, seed)
        if isinstance(evidence, str):
            why = evidence
        else:
            line, learnt = evidence
            frames = replayed(machine_as_calibrated(machine, learnt)).frames
            why = describe_contradicted_learnt_priors(frames["nuisances"])
            errors = SharedErrors.from_frames(frames)
            for arm, raw in ((BOTH, frames["cycles"]), (EVIDENCE, _on_own_scale(frames["cycles"]))):
                count(arm, frames, raw if why else calibrate_cycles(raw, line, errors))
    return ScaledShift(
        seed,
        hours,
        list(log.truth.payload_kg),
        list(log.truth.dump_s),
        sorted(log.truth.habits),
        str({k: v for k, v in wrong._asdict().items() if k.endswith("_1") and v != 1.0}),
        shift,
        cycles,
        begin_s,
        why,
        seconds,
    )


def table(found: Sequence[ScaledShift]) -> str:
    """A row an arm: how often intervals hold, and how wide they are."""
    head = ["arm", "shifts", "open", "total within U", "payloads counted within U", "r.m.s. / u"]
    head += ["U (median)", "of it common", "single payloads within 2 u"]
    return markdown(head, list(_rows(found)))


def _rows(found: Sequence[ScaledShift]) -> Iterator[list[str]]:
    for arm in (NEITHER, TICKET, EVIDENCE, BOTH):
        group = [each for each in found if arm in each.shift]
        said = [each for each in group if np.isfinite(each.total(arm)[0])]
        if not said:
            continue
        whole = [(each.total(arm)[0] - sum(each.true_kg)) / each.total(arm)[1] for each in said]
        matched = [each.matched(arm) for each in said]
        matched = [each for each in matched if each[0] > 0.0]
        off = [(mine - true) / u for mine, true, u, _ in matched]
        yield [
            arm,
            str(len(group)),
            str(len(said)),
            f"{np.sum(np.abs(whole) <= K)} of {len(whole)}",
            f"{np.sum(np.abs(off) <= K)} of {len(off)}",
            f"{np.sqrt(np.mean(np.square(off))):.2f}",
            f"{np.median([K * u / mine for mine, _, u, _ in matched]):.2%}",
            f"{np.median([K * common / mine for mine, _, _, common in matched]):.2%}",
            _single(said, arm),
        ]


def _single(found: Sequence[ScaledShift], arm: str) -> str:
    """Payloads of cycles within two of their own u."""
    held = [
        abs(row["payload_kg"] - true_kg) <= K * row["payload_u_kg"]
        for each in found
        for row, true_kg in each.pairs(arm)
    ]
    return f"{np.mean(held):.1%} of {len(held)}"


def main(
    shifts: int = 40,
    first: int = 0,
    hours: float = 2.0,
    clean: bool = False,
    wrong_scale: Annotated[bool, typer.Option("--wrong-scale")] = False,
    kept: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    def one(seed: int) -> ScaledShift:
        made = scaled(seed, hours, clean=clean, wrong_scale=wrong_scale)
        print(seed, made.why, [round(s) for s in made.seconds], flush=True)
        return made

    found = run_seeds(range(first, first + shifts), one, kept, ScaledShift)
    print(table(list(found)))


if __name__ == "__main__":
    typer.run(main)
