"""Recursive restricted total least squares beside `rls`, `rtls` and `pooled`, over simulated logs.

    python -P benchmarks/restricted_tls.py [--logs 40]

The restricted form knows the whole covariance of the noise of [A f], correlations among its columns
included; `rtls` knows their standard deviations. They are the same where the noises are
independent, as of an accelerometer beside encoders; an acceleration derived from the speed shares
its noise.
"""

from typing import Final

import numpy as np
import polars as pl
import typer
from scipy.linalg import eigh

from analysis.model.axes import X, make_straight_regressor_and_force
from analysis.model.machine import Channel, Machine
from analysis.model.windows import mark_samples_in_accepted_windows
from analysis.simulation import simulate_campaign
from analysis.stages.gating.gate import mark_settled_windows
from analysis.stages.noise.column_noise import collect_axis_noise
from benchmarks.page import markdown
from benchmarks.simulated import scenario
from replay import load_machine, run
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels

LOADED: Final = 150.0
METHODS: Final = ("rls", "rtls", "pooled")
FORGETTING: Final = 0.998


def machines() -> dict[str, Machine]:
    """By what gives the acceleration."""
    accelerometer = load_machine("cat262c.toml", [f"settings.trace.methods={list(METHODS)}"])
    derived = {"acc_x_m_s2": Channel(derive="d/dt speed_x_m_s")}
    settings = accelerometer.settings.copy_with_changes({"forces.acceleration": "kinematic"})
    return {
        "accelerometer": accelerometer,
        "derived from the wheels": accelerometer.model_copy(
            update={"channels": accelerometer.channels | derived, "settings": settings}
        ),
    }


def restricted(
    excitation: pl.DataFrame, samples: np.ndarray, machine: Machine, noise: pl.DataFrame
) -> float:
    """The mass of the last state: the smallest generalised eigenvector of the discounted Gram."""
    A, f = make_straight_regressor_and_force(excitation, machine.settings)
    z = np.column_stack([A, f])[samples]
    weights = FORGETTING ** np.arange(len(z))[::-1]
    covariance = collect_axis_noise(X, machine.settings, noise).moving_mean_covariance
    gram = (z * weights[:, None]).T @ z
    _, vectors = eigh(gram, covariance)
    return float(-vectors[0, 0] / vectors[-1, 0])


def main(logs: int = 40) -> None:
    rows: list[list[str]] = []
    for name, machine in machines().items():
        errors: dict[str, list[float]] = {}
        for seed in range(logs):
            plan = scenario(seed, loads_kg=(LOADED,), runs=3)
            (log,) = simulate_campaign(plan)
            truth = float(log.trials["mass_kg"][0])
            replayed = run(MemoryLog(log), copy_machine_with_simulated_channels(machine, log))
            frames = replayed.frames
            for method in METHODS:
                if (frame := frames[f"estimates/{method}"]).height:
                    errors.setdefault(method, []).append(frame["mass_kg"][-1] - truth)
            answer = frames["loads"]["mass_kg"].drop_nulls()
            if answer.len():
                errors.setdefault("joint fit", []).append(answer[0] - truth)
            # what `rtls` is fed
            excitation, settings = frames["excitation"], machine.settings
            settled = mark_settled_windows(excitation, frames["gate"], settings)
            fed = mark_samples_in_accepted_windows(settled, settings.gate.window_samples)
            mass = restricted(excitation, fed, machine, frames["noise"])
            errors.setdefault("restricted TLS", []).append(mass - truth)
        for method, found in errors.items():
            e = np.array(found)
            spread = f"{e.mean():.1f} ± {e.std(ddof=1) / np.sqrt(e.size):.1f}"
            rows.append([name, method, str(e.size), spread, f"{np.sqrt(np.mean(e**2)):.1f}"])
    print(markdown(["acceleration", "estimator", "logs", "bias kg", "RMSE kg"], rows))


if __name__ == "__main__":
    typer.run(main)
