"""Golden replays: small logs whose results are kept, and what may differ from them.

    python -m tests.golden.golden            keep the results as they are now (make golden-update)
    python -m tests.golden.golden --logs     make the logs anew before that

Beside each log lies `NAME.golden.json`: the digest of every frame with the processor and the
libraries that gave it, and values of the frames. Where processor and libraries agree, frames are
equal bit for bit. Elsewhere numbers agree to 1e-9 of their size, and windows are accepted alike
unless the index is next to its threshold.
"""

import json
import math
import platform
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from analysis import Run
from replay import TimeAxis, load_machine, open_log, run

FOLDER: Final = Path(__file__).resolve().parent
UPDATE: Final = "make golden-update"
_ALL_METHODS: Final = (
    'settings.trace.methods=["ls", "rls", "fgls", "tls", "rtls", "huber", "pooled"]'
)
#: Of each log: its machine file, and what is set beside it.
LOGS: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "straight.mcap": ("cat262c.toml", (_ALL_METHODS,)),
    "planar.mcap": ("cat262c.toml", ()),
    "table.csv": (str(FOLDER / "table.machine.toml"), ()),
}
#: Relative difference of numbers that another processor may make.
RTOL: Final = 1e-9
#: So near its threshold an index may accept on one processor and refuse on another.
MARGIN_NAT: Final = 1e-6
#: Of frames with a row a sample, every so many milliseconds are kept.
_EVERY_NS: Final = {"gate": 100_000_000, "estimates": 250_000_000}
_WHOLE: Final = ("segments", "planar", "loads", "masses", "verdict")
_LIBRARIES: Final = ("python", "numpy", "scipy", "numba", "polars")


def replay(log: str) -> Run:
    """Replay a golden log as it lies beside this file."""
    machine_file, overrides = LOGS[log]
    machine = load_machine(machine_file, overrides)
    time = TimeAxis(machine.log.time, machine.log.time_unit) if machine.log.time else None
    with open_log(FOLDER / log, time=time) as opened:
        return run(opened, machine)


def reference_path(log: str) -> Path:
    """Where the results of a log are kept."""
    return FOLDER / f"{Path(log).stem}.golden.json"


def reference(replayed: Run) -> dict[str, Any]:
    """Make what is kept of a replay."""
    taken = replayed.provenance.fingerprint
    assert taken is not None
    return {
        "made_on": made_on(replayed),
        "digests": taken.frames,
        "threshold_nat": replayed.provenance.settings.gate.threshold_nat,
        "values": {
            name: {"rows": kept.height, **kept.to_dict(as_series=False)}
            for name, frame in replayed.frames.items()
            if (kept := _kept(name, frame)) is not None
        },
    }


def made_on(replayed: Run) -> dict[str, str]:
    """Name the processor and the libraries: where they agree, so does every bit."""
    versions = replayed.provenance.versions
    return {"processor": _processor(), **{name: versions[name] for name in _LIBRARIES}}


def _processor() -> str:
    described = Path("/proc/cpuinfo")
    lines = described.read_text(encoding="utf-8").splitlines() if described.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else f"{platform.machine()} {platform.processor()}"


def _kept(name: str, frame: pl.DataFrame) -> pl.DataFrame | None:
    """The rows of a frame that are kept, by time alone: other rows do not choose them."""
    family = name.partition("/")[0]
    if family in _WHOLE:
        return frame.select(pl.exclude("meaning"))
    if family in _EVERY_NS:
        return frame.filter(pl.col("t_ns") % _EVERY_NS[family] == 0)
    return None


def differences(replayed: Run, kept: Mapping[str, Any]) -> Iterator[str]:
    """Yield what differs from the kept results beyond what it may, a line each."""
    taken = replayed.provenance.fingerprint
    assert taken is not None
    if made_on(replayed) == kept["made_on"]:
        for name in dict.fromkeys((*kept["digests"], *taken.frames)):
            if kept["digests"].get(name) != taken.frames.get(name):
                yield f"{name}: not bit for bit as on this processor before"
    yield from value_differences(replayed, kept)


def value_differences(replayed: Run, kept: Mapping[str, Any]) -> Iterator[str]:
    """Yield kept values that differ by more than another processor may make them."""
    now = json.loads(json.dumps(reference(replayed)["values"]))
    if list(now) != list(kept["values"]):
        yield f"frames: {', '.join(now)}; golden file has {', '.join(kept['values'])}"
        return
    for name, before in kept["values"].items():
        after = now[name]
        if list(before) != list(after):
            yield f"{name}: columns {', '.join(after)}; golden file has {', '.join(before)}"
        elif before["rows"] != after["rows"]:
            yield f"{name}: {after['rows']} rows, golden file has {before['rows']}"
        else:
            near = _near(before, kept["threshold_nat"]) if name == "gate" else set()
            yield from _column_differences(name, before, after, near)


def _near(gate: Mapping[str, Any], threshold: float) -> set[int]:
    """Rows of the gate whose index is next to its threshold."""
    return {
        row
        for column in ("mi_x_nat", "mi_z_nat")
        for row, index in enumerate(gate.get(column, ()))
        if index is not None and abs(index - threshold) <= MARGIN_NAT
    }


def _column_differences(
    name: str, before: Mapping[str, Any], after: Mapping[str, Any], near: set[int]
) -> Iterator[str]:
    for column, values in before.items():
        if column == "rows":
            continue
        decided = column.startswith(("accepted", "reason"))
        for row, (old, new) in enumerate(zip(values, after[column], strict=True)):
            if not (_alike(old, new) or (decided and row in near)):
                yield f"{name}: {column} in row {row} is {new}, golden file has {old}"
                break


def _alike(old: Any, new: Any) -> bool:
    if isinstance(old, float) and isinstance(new, float):
        return math.isclose(old, new, rel_tol=RTOL)
    return old == new


def margin(replayed: Run) -> float:
    """How near to its threshold any index comes, in nat."""
    gate = replayed.frames["gate"]
    threshold = replayed.provenance.settings.gate.threshold_nat
    indices = [gate[name] for name in ("mi_x_nat", "mi_z_nat") if name in gate.columns]
    return min(float((index - threshold).abs().min() or math.inf) for index in indices)


def make_logs() -> None:
    """Make the logs anew: two by the simulator, and a table of position and force."""
    from replay.simulation.log_truth import make_truth_path_of_log
    from replay.simulation.scenario_file import load_scenario_file
    from replay.simulation.simulate_logs import simulate_scenario_to_logs

    for name in ("straight", "planar"):
        scenario = load_scenario_file(FOLDER / f"{name}.scenario.toml")
        for written in simulate_scenario_to_logs(
            scenario, FOLDER / f"{name}.mcap", overwrites=True
        ):
            make_truth_path_of_log(written).unlink()
    sledge().write_csv(FOLDER / "table.csv")


def sledge() -> pl.DataFrame:
    """A sledge of 120 kg pushed to and fro, rounded as an encoder and a load cell would."""
    t = np.arange(2500) / 100.0
    omega = 2.0 * math.pi / 5.0
    speed = 0.3 * np.sin(omega * t) + 0.1 * np.sin(2.7 * omega * t)
    acc = 0.3 * omega * np.cos(omega * t) + 0.27 * omega * np.cos(2.7 * omega * t)
    position = -0.3 / omega * np.cos(omega * t) - 0.1 / (2.7 * omega) * np.cos(2.7 * omega * t)
    noise = np.random.default_rng(3).normal(0.0, 1.0, t.size)
    force = 120.0 * acc + 200.0 * speed + 20.0 * np.sign(speed) + noise
    return pl.DataFrame(
        {"time_s": t, "position_m": np.round(position, 5), "force_N": np.round(force, 1)}
    )


def main() -> None:
    """Keep the results of every log as they are now."""
    if "--logs" in sys.argv[1:]:
        make_logs()
    for log in LOGS:
        replayed = replay(log)
        if margin(replayed) <= MARGIN_NAT:
            sys.exit(
                f"{log}: an index lies within {MARGIN_NAT} nat of its threshold; change the log"
            )
        text = json.dumps(reference(replayed), ensure_ascii=False, allow_nan=False)
        reference_path(log).write_text(f"{text}\n", encoding="utf-8")
        print(f"{log}: {replayed.provenance.fingerprint}")  # noqa: T201


if __name__ == "__main__":
    main()
