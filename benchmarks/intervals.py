"""How often nominal 95 % intervals contain the truth, over simulated starts with coloured noise.

    python -P benchmarks/intervals.py [--starts 2100] [--write]

One long log of starts is simulated a noise and cut into logs of one, three or thirty; each goes
through the stages by itself. `--write` puts the table into docs/what-a-mass-is-worth.md.
"""

import time

import numpy as np
import polars as pl
import typer

from analysis import Machine
from analysis.model.axes import make_straight_regressor_and_force
from analysis.simulation import simulate_campaign
from analysis.stages.estimation.method_estimates import summarise_masses, trace_estimates
from analysis.stages.gating.gate import gate_windows
from analysis.stages.gating.segments import assign_pooled_manoeuvre_numbers_to_samples
from analysis.stages.motion.smooth import compute_trailing_mean
from benchmarks.page import markdown, put
from benchmarks.simulated import coloured, cut, excitation, scenario
from estimators.methods import pooled
from replay import load_machine

NOISES = ((0.0, 0.1), (60.0, 0.1), (60.0, 0.3))
STARTS_A_LOG = (1, 3, 30)
CHUNK = 300
HEAD = {
    "segments": "`segments`",
    "textbook": "σ²(AᵀA)⁻¹",
    "newey_west": "Newey–West",
    "pooled": "pooled",
    "windows ls": "LS windows",
    "ls": "mean of LS windows",
    "windows tls": "TLS windows",
    "tls": "mean of TLS windows",
    "windows rls": "RLS states",
    "rls": "last RLS state",
}


def of_others(A: np.ndarray, f: np.ndarray, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Textbook and Newey-West (1987) deviations of each segment's mass."""
    textbook, newey_west = [], []
    for number in np.unique(ids[ids >= 0]):
        X, y = A[ids == number], f[ids == number]
        bread = np.linalg.inv(X.T @ X)
        e = y - X @ (bread @ X.T @ y)
        textbook.append(np.sqrt(e @ e / (y.size - 2) * bread[0, 0]))
        score = X * e[:, None]
        meat = score.T @ score
        lags = int(4.0 * (y.size / 100.0) ** (2.0 / 9.0))
        for lag in range(1, lags + 1):
            pair = score[lag:].T @ score[:-lag] * (1.0 - lag / (lags + 1.0))
            meat += pair + pair.T
        newey_west.append(np.sqrt((bread @ meat @ bread)[0, 0]))
    return np.array(textbook), np.array(newey_west)


def is_same_log(frame: pl.DataFrame, machine: Machine) -> dict[str, np.ndarray]:
    """Masses and deviations (rows, 2) of everything that the log gives."""
    settings = machine.settings
    gated = gate_windows(frame, settings)
    ids = assign_pooled_manoeuvre_numbers_to_samples(frame, gated, settings)
    A, f = make_straight_regressor_and_force(frame, settings)
    segments = pooled.estimate_along_log(A, f, ids)
    mass = segments.theta[:, 0]
    textbook, newey_west = of_others(A, f, ids)
    estimates = trace_estimates(frame, gated, settings)
    out = {
        "segments": np.c_[mass, segments.std[:, 0]],
        "textbook": np.c_[mass, textbook],
        "newey_west": np.c_[mass, newey_west],
    }
    for method, table in estimates.items():
        if method != "pooled":
            known = table.select("mass_kg", "mass_std_kg").drop_nulls()
            out[f"windows {method}"] = known.to_numpy()
    for row in summarise_masses(frame, gated, estimates, machine).iter_rows(named=True):
        out[row["method"]] = np.array([[row["mass_kg"], row["mass_std_kg"]]])
    return out


def covered(values: list[np.ndarray], truth_kg: float) -> float:
    mass, std = np.concatenate(values).T
    return float(np.mean(np.abs(mass - truth_kg) < 1.96 * std))


def white_as_strong(force_N: float, lasting_s: float) -> float:
    """White noise that has the variance of white 60 N and the coloured after the mean of ten."""
    smoothed = compute_trailing_mean(coloured(1_000_000, force_N, lasting_s, 100.0, 0), 10)[9:]
    return float(np.sqrt(60.0**2 + 10.0 * smoothed.var()))


def main(starts: int = 2100, write: bool = False) -> None:
    began = time.monotonic()
    rows: list[list[str]] = []
    for force_N, lasting_s in NOISES:
        noise_N = white_as_strong(force_N, lasting_s)
        machine = load_machine(
            "cat262c.toml",
            [
                'settings.trace.methods=["ls","rls","tls","pooled"]',
                f"settings.noise.force_N={noise_N:.1f}",
                "settings.noise.acc_m_s2=0.01",
                "settings.noise.speed_m_s=0.005",
            ],
        )
        found: dict[int, dict[str, list[np.ndarray]]] = {n: {} for n in STARTS_A_LOG}
        for seed in range(1, starts // CHUNK + 1):
            # brakes that the sensors see: what the model leaves out is no matter of noise
            plan = scenario(seed, runs=CHUNK, brake_measured_share=1.0)
            log = next(iter(simulate_campaign(plan)))
            whole = excitation(log, machine, force_N, lasting_s)
            for runs, values in found.items():
                for frame in cut(whole, log, runs):
                    for name, value in is_same_log(frame, machine).items():
                        values.setdefault(name, []).append(value)
        for runs, values in found.items():
            noise = f"white and {force_N:.0f} N of {lasting_s:g} s" if force_N else "white"
            shares = [f"{100 * covered(values[name], 3614.0):.1f}" for name in HEAD]
            count = sum(len(v) for v in values["segments"])
            rows.append([noise, str(runs), str(count), *shares])
            print(rows[-1], f"{time.monotonic() - began:.0f} s", flush=True)
    table = markdown(["force noise", "starts a log", "starts", *HEAD.values()], rows)
    print(table)
    if write:
        put("what-a-mass-is-worth.md", "make coverage", table)


if __name__ == "__main__":
    typer.run(main)
