"""How near the energy of cycles is to the simulator's own work, and how often intervals hold.

    python -P benchmarks/energy.py [--shifts 20] [--first 93000] [--hours 0.5] [--write]

Shifts are drawn as in `benchmarks/shift_logs.py`: machine, ground, delays, gain and offset of the
force. The truth is the work of the simulated forces at the simulated speeds, over the phases that
the review found. All cycles of a shift share one drawn gain, so that few shifts say little of how
often intervals hold: beside what this draw gave stands the mean over all gains that the machine
file allows. `--write` puts the table into docs/reviewing-a-shift.md.
"""

import tempfile
from contextlib import ExitStack
from math import erf, sqrt
from pathlib import Path
from typing import Final

import numpy as np
import typer
from numpy.typing import NDArray

from analysis.cycles.cycle_energy import PARTS, PHASES, WHOLE, EnergyRow, compute_shift_energy
from analysis.cycles.cycles_lost_in_gaps import find_spans_of_missing_channels_ns
from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.simulation import Scenario
from analysis.simulation.logs.shift_logs import ShiftSimulation
from benchmarks.page import markdown, put
from benchmarks.shift_logs import GAIN_U, drawn_shift
from estimators.arrays import Floats
from replay import open_log
from replay.pipeline import run
from replay.simulation.simulate_logs import simulate_scenario_to_logs

#: Of the true integrals, in Hz.
_RATE_HZ: Final = 200.0
_NS: Final = 10**9
_J_PER_KWH: Final = 3.6e6


class TrueEnergy:
    """Cumulated true energies of a simulated shift, in time; by part, in kWh."""

    def __init__(self, scenario: Scenario, digging_ns: list[tuple[int, int]]) -> None:
        assert scenario.shift is not None
        times: list[NDArray[np.int64]] = []
        parts: list[Floats] = []
        body = scenario.machine
        for log in ShiftSimulation(scenario, scenario.shift).simulate_logs():
            line = log.timeline
            t = np.arange(line.start_ns, line.end_ns, int(_NS / _RATE_HZ))
            true = line.sample(t)
            v, mass, force = true.speed_x_m_s, true.mass_kg, true.force_x_N
            slip = force / body.slip_stiffness_N if body.slip_stiffness_N else np.zeros(t.size)
            wheels = v + np.abs(v) * slip
            uphill = mass * (true.specific_force_x_m_s2 - true.acc_x_m_s2)
            turning = true.torque_z_N_m * true.yaw_rate_rad_s
            drives = force * v > 0.0
            work = np.where(drives, force * wheels, 0.0) + np.maximum(turning, 0.0)
            kinetic = np.where(drives, mass * true.acc_x_m_s2 * v, 0.0)
            slope = np.where(drives, uphill * v, 0.0)
            resisted = body.friction_N_s_m * v**2 + body.coulomb_N * abs(v)
            digs = np.zeros(t.size, np.bool_)
            for start, end in digging_ns:
                if end < line.start_ns or start >= line.end_ns:
                    continue
                # until the machine stands
                rests = t[(t >= end) & (v == 0.0)][:1]
                digs |= (t >= start) & (t <= (rests[0] if rests.size else end))
            digging = np.where(drives & digs, force * v - kinetic - slope - resisted, 0.0)
            braking = np.where((force * v < 0.0) & ~digs, -force * v, 0.0)
            rest = work - kinetic - slope - digging
            times.append(t)
            parts.append(np.stack([work, kinetic, slope, rest, digging, braking]))
        self.t_ns = np.concatenate(times)
        power = np.concatenate(parts, axis=1) / _RATE_HZ / _J_PER_KWH
        self.total_kWh = np.concatenate([np.zeros((len(PARTS), 1)), np.cumsum(power, axis=1)], 1)

    def during(self, start_ns: int, end_ns: int) -> Floats:
        """(parts,) in kWh."""
        first, last = np.searchsorted(self.t_ns, [start_ns, end_ns])
        return self.total_kWh[:, last] - self.total_kWh[:, first]


def replay_shift(scenario: Scenario, machine: Machine, folder: Path) -> tuple[Run, Machine]:
    """Simulate a shift and replay its logs; with the machine as it was replayed."""
    logs = simulate_scenario_to_logs(scenario, folder / "shift.mcap", overwrites=True)
    with ExitStack() as stack:
        made = run([stack.enter_context(open_log(path)) for path in logs], machine)
    return made, machine.model_copy(update={"settings": made.provenance.settings})


def energies_beside_truth(
    made: Run, machine: Machine, scenario: Scenario
) -> list[tuple[EnergyRow, Floats]]:
    """Each row of the energy table, and its true parts in kWh."""
    frames, t0_ns = made.frames, made.provenance.t0_unix_ns
    gaps = find_spans_of_missing_channels_ns(frames["excitation"], frames["aligned"])
    digs = frames["digging"].select("start_t_ns", "end_t_ns").rows()
    true = TrueEnergy(scenario, [(s + t0_ns, e + t0_ns) for s, e in digs])
    found = compute_shift_energy(frames, machine, gaps)
    own = {row.cycle for row in found.rows}
    edges: dict[tuple[int, str], tuple[int, int]] = {}
    for row in frames["cycles"].iter_rows(named=True):
        start, end, number = row["start_t_ns"], row["end_t_ns"], row["cycle"]
        edges[number, WHOLE] = (start, end)
        if None not in (row["dig_t_ns"], row["load_s"], row["haul_s"]):
            loaded = row["dig_t_ns"] + int(row["load_s"] * _NS)
            at = [start, row["dig_t_ns"], loaded, loaded + int(row["haul_s"] * _NS), end]
            edges |= {
                (number, phase): (b, e) for phase, b, e in zip(PHASES, at[:-1], at[1:], strict=True)
            }
    by_key = {
        key: true.during(b + t0_ns, e + t0_ns) for key, (b, e) in edges.items() if key[0] in own
    }
    whole = [k for k in by_key if k[1] == WHOLE]
    result: list[tuple[EnergyRow, Floats]] = []
    for row in found.rows:
        if row.cycle is not None:
            result.append((row, by_key[row.cycle, row.phase]))
        elif row.phase == WHOLE:
            result.append((row, np.sum([by_key[k] for k in whole], axis=0)))
    return result


def holds_over_gains(error_kWh: float, u_kWh: float, found_kWh: float, gain_1: float) -> float:
    """Probability that the interval holds where the force's gain is any that the file allows.

    The energy found is in proportion to the gain; so the error without it, and what each gain adds.
    """
    own_kWh = error_kWh - found_kWh * (1.0 - 1.0 / gain_1)
    std_kWh = max(GAIN_U * abs(found_kWh), 1e-12)
    low, high = ((sign * 2.0 * u_kWh - own_kWh) / std_kWh for sign in (-1.0, 1.0))
    return 0.5 * (erf(high / sqrt(2.0)) - erf(low / sqrt(2.0)))


def table(pairs: list[list[tuple[EnergyRow, Floats]]], gains: list[float]) -> str:
    """Errors and coverage by part, of cycles and of whole shifts.

    Args:
        pairs: of each shift.
        gains: of the force, of each shift.
    """
    rows: list[list[str]] = []
    for name, chosen in (("shift", None), ("cycle", WHOLE), ("phase", "")):
        for place, part in enumerate(PARTS):
            error, u, truth, holds = [], [], [], []
            both = zip(pairs, gains, strict=True)
            for gain_1, row, true in ((g, *pair) for shift, g in both for pair in shift):
                is_shift = row.cycle is None
                if chosen is None and not is_shift:
                    continue
                if chosen is not None and (is_shift or (row.phase == WHOLE) != (chosen == WHOLE)):
                    continue
                amount = getattr(row, part)
                if amount.u_kWh > 0.0 and (abs(true[place]) > 0.0 or part != "digging"):
                    error.append(amount.kWh - true[place])
                    u.append(amount.u_kWh)
                    truth.append(true[0])
                    holds.append(holds_over_gains(error[-1], u[-1], amount.kWh, gain_1))
            if not error:
                continue
            e, w, t = map(np.array, (error, u, truth))
            t = np.maximum(t, 1e-9)
            rows.append(
                [
                    name,
                    part,
                    str(e.size),
                    f"{100 * np.median(abs(e) / t):.2f} %",
                    f"{100 * np.quantile(abs(e) / t, 0.95):.2f} %",
                    f"{100 * np.median(2 * w / t):.2f} %",
                    f"{100 * np.mean(abs(e) <= 2 * w):.1f} %",
                    f"{100 * np.mean(holds):.1f} %",
                ]
            )
    head = ["of a", "part", "number", "median error of the work", "95 % of errors below"]
    head += ["median U of the work", "interval holds", "over all gains"]
    return markdown(head, rows)


def main(shifts: int = 20, first: int = 93000, hours: float = 0.5, write: bool = False) -> None:
    """Draw shifts, and compare."""
    pairs: list[list[tuple[EnergyRow, Floats]]] = []
    gains: list[float] = []
    for seed in range(first, first + shifts):
        scenario, machine = drawn_shift(seed, hours)
        with tempfile.TemporaryDirectory() as folder:
            made, used = replay_shift(scenario, machine, Path(folder))
        pairs.append(energies_beside_truth(made, used, scenario))
        gains.append(scenario.sensors.force_gain)
        whole = pairs[-1][0] if pairs[-1] else None
        if whole is None:
            print(seed, "no cycle", flush=True)
            continue
        row, true = whole
        print(
            seed,
            *(
                f"{p} {getattr(row, p).kWh:.3f}±{2 * getattr(row, p).u_kWh:.3f}({t:.3f})"
                for p, t in zip(PARTS, true, strict=True)
            ),
            flush=True,
        )
    text = table(pairs, gains)
    print(text)
    if write:
        put("reviewing-a-shift.md", "energy of cycles", text)


if __name__ == "__main__":
    typer.run(main)
