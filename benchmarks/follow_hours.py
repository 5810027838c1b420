"""Whether memory stays flat over a shift: hours of samples by a simulated clock.

    python -P benchmarks/follow_hours.py [--hours 8] [--rate 20]

A few simulated starts, at `--rate` Hz, are driven again and again with later stamps. Every second
of the log is a look: samples in, rows stepped, their digests kept, as `follow -o` does.
"""

import os
import resource
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import polars as pl
import typer

from analysis.model.machine import Machine
from analysis.online.follower import Follower
from analysis.online.growing_log import copy_machine_with_causal_filters
from analysis.simulation import Scenario
from benchmarks.follow_live import NOISE
from benchmarks.page import markdown
from estimators.interpreted import compile_even_short_loops
from estimators.threads import limit_blas_to_one_thread
from replay import load_machine, open_log
from replay.follow.agreement import FollowedDigests
from replay.inputs.channel_inputs import list_channel_fields
from replay.simulation.simulate_logs import simulate_scenario_to_logs

SECOND_NS = 10**9


def driven(folder: Path, machine: Machine, rate_hz: float) -> dict[str, pl.DataFrame]:
    """Samples of some starts, by topic."""
    plan = {"campaign": {"loads_kg": [150], "runs": 4}, "sensors": {"rate_hz": rate_hz}}
    (log,) = simulate_scenario_to_logs(Scenario.model_validate(plan), folder / "starts.mcap")
    with open_log(log) as opened:
        return opened.read_many(list_channel_fields(copy_machine_with_causal_filters(machine)))


def later(samples: pl.DataFrame, by_ns: int) -> pl.DataFrame:
    """The same samples, stamped later."""
    return samples.with_columns(pl.col("log_time_ns", "header_stamp_ns") + by_ns)


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


@limit_blas_to_one_thread()
def main(hours: float = 8.0, rate: float = 20.0) -> None:
    rows: list[list[str]] = []
    with TemporaryDirectory() as name, compile_even_short_loops():
        machine = load_machine("cat262c.toml", [*NOISE, f"settings.align.rate_hz={rate}"])
        window = round(machine.settings.gate.window_samples * rate / 100.0)
        changed = machine.settings.copy_with_changes({"gate.window_samples": window})
        machine = machine.model_copy(update={"settings": changed})
        topics = driven(Path(name), machine, rate)
        begin = min(frame["log_time_ns"][0] for frame in topics.values())
        end = max(frame["log_time_ns"][-1] for frame in topics.values())
        lap_ns = (end - begin) // SECOND_NS * SECOND_NS
        follower, digests = Follower(machine), FollowedDigests()
        spent = time.process_time()
        for second in range(round(hours * 3600) + 1):
            lap, at = divmod(second * SECOND_NS, lap_ns)
            inside = pl.col("log_time_ns").is_between(
                begin + at, begin + at + SECOND_NS, closed="left"
            )
            for topic, samples in topics.items():
                follower.append_samples(topic, later(samples.filter(inside), lap * lap_ns))
            digests.add_followed_rows(follower.collect_complete_rows())
            if second % 1800 == 0 and second:
                rows.append(
                    [
                        f"{second / 3600:g} h",
                        f"{follower.rows_stepped:,}",
                        f"{follower.manoeuvres:,}",
                        f"{follower.log.kept_sample_count:,}",
                        f"{resident_mb():.1f}",
                    ]
                )
                print(rows[-1], flush=True)
    print(markdown(["log", "rows", "manoeuvres", "samples kept", "resident MB"], rows))
    most_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"at most {most_mb:.0f} MB; {time.process_time() - spent:.0f} s of the processor")


if __name__ == "__main__":
    typer.run(main)
