"""The command `reproduce`: the paper's tables, figures and claims over many simulated trials."""

from collections.abc import Callable, Collection, Iterator
from typing import Final

import polars as pl

from analysis.calibration.straight_line import calibrate
from analysis.machine import Channel, Machine
from analysis.reproduction import claims, excitation_figures, figures, paper, tables
from analysis.reproduction.campaign import Campaign, errors, judged_anew, run_bound_kg
from analysis.reproduction.claims_item import WINDOW_S, claims_item
from analysis.reproduction.excitation import excited, steady_drive
from analysis.reproduction.item import Item
from analysis.reproduction.table1 import raw_units, table_1
from analysis.reproduction.table1_findings import table_1_item
from analysis.reproduction.torque_chain import TorqueChain, through
from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from analysis.simulation.waveforms import ForceWave, TorqueWave
from replay.demo import seeded
from replay.machine_file import load_machine
from replay.memory_log import MemoryLog, reading_memory
from replay.pipeline import run

#: All there is, in the paper's order.
ITEMS: Final = (
    *("table1", "table2", "table3", "table4"),
    *("fig2", "fig3", "fig4", "fig5", "fig6", "fig7", "fig8"),
    "claims",
)
#: Items made of whole campaigns.
_OF_CAMPAIGNS: Final = ("table2", "table3", "table4", "fig6", "fig7", "fig8", "claims")
#: A long cruise is simulated once for so many windows of Table 1.
_TRIALS_A_CRUISE: Final = 5


def reproduce(
    wanted: Collection[str],
    *,
    trials: int,
    campaigns: int,
    seed: int,
    on_stage: Callable[[str], None],
) -> list[Item]:
    """Find tables, figures and claims anew.

    Args:
        wanted: of `ITEMS`.
        trials: windows of each length in Table 1; a fifth as many long cruises.
        campaigns: simulated campaigns for Tables 2 to 4, Figures 6 to 8 and the claims.
        seed: of the first; each campaign has the next.
        on_stage: told each piece of work as it begins, as many as `work` counts.

    Returns:
        The items, in the paper's order.
    """
    machine, scenario = load_machine("cat262c.toml"), seeded(Scenario(), seed)
    found: dict[str, Item] = {}
    windows = pl.DataFrame()
    if {"table1", "claims"} & set(wanted):
        on_stage("windows")
        drive, sensors = steady_drive(scenario), scenario.sensors
        lengths = tuple(paper.TABLE_1_KG) if "table1" in wanted else (WINDOW_S,)
        windows = table_1(drive, sensors, trials, windows_s=lengths)
        found["table1"] = table_1_item(windows, raw_units(drive, sensors, trials))
    rows: dict[str, list[pl.DataFrame]] = {}
    for number in range(campaigns if set(_OF_CAMPAIGNS) & set(wanted) else 0):
        on_stage(f"campaign {number + 1}")
        for name, frame in _campaign(seeded(scenario, seed + number), machine, wanted).items():
            rows.setdefault(name, []).append(frame.with_columns(campaign=pl.lit(number)))
    seen = {name: pl.concat(frames, how="vertical_relaxed") for name, frames in rows.items()}
    if "table2" in seen:
        found["table2"] = tables.table_2_item(seen["table2"], TorqueChain())
    if "table3" in seen:
        found["table3"] = tables.table_3_item(seen["table3"])
    if "table4" in seen:
        found["table4"] = tables.table_4_item(seen["table4"])
    if "loads" in seen:
        found["fig6"] = figures.fig_6_item(seen["loads"])
        found["fig7"] = figures.fig_7_item(seen["loads"])
        found["fig8"] = figures.fig_8_item(seen["loads"])
    if {"fig2", "fig3"} & set(wanted):
        on_stage("linear motion")
        linear = replay_simulated(excited(scenario, force=ForceWave(), torque=None), machine)
        found["fig2"] = excitation_figures.fig_2_item(linear)
        found["fig3"] = excitation_figures.fig_3_item(linear)
    if "fig4" in wanted:
        on_stage("rotation")
        spun = excited(scenario, force=None, torque=TorqueWave())
        found["fig4"] = excitation_figures.fig_4_item(replay_simulated(spun, _turning(machine)))
    if "fig5" in wanted:
        on_stage("figure 5")
        found["fig5"] = figures.fig_5_item(replay_simulated(_short(scenario), machine))
    if "claims" in wanted:
        cruises = _cruises(scenario, machine, trials, seed, on_stage)
        found["claims"] = claims_item(windows, seen["claims"], cruises)
    return [found[name] for name in ITEMS if name in wanted]


def work(wanted: Collection[str], *, trials: int, campaigns: int) -> int:
    """How many pieces of work there are to tell of."""
    of = set(wanted)
    return (
        bool({"table1", "claims"} & of)
        + bool(set(_OF_CAMPAIGNS) & of) * campaigns
        + bool({"fig2", "fig3"} & of)
        + ("fig4" in of)
        + ("fig5" in of)
        + ("claims" in of) * _cruise_count(trials)
    )


def replay_simulated(
    scenario: Scenario,
    machine: Machine,
    chain: Callable[[SimulatedLog], SimulatedLog] = lambda log: log,
) -> Campaign:
    """Simulate a campaign and replay it from memory.

    Args:
        scenario: what to simulate.
        machine: settings and body; its channels are read from the simulation's topics.
        chain: what the signals pass through before they are recorded.
    """
    logs = [chain(log) for log in simulate_campaign(scenario)]
    replayed = run([MemoryLog(log) for log in logs], reading_memory(machine, logs[0]))
    return Campaign(
        scenario,
        replayed,
        pl.concat([log.runs for log in logs]),
        pl.concat([log.noise_free for log in logs]),
    )


def _campaign(
    scenario: Scenario, machine: Machine, wanted: Collection[str]
) -> dict[str, pl.DataFrame]:
    """What one campaign gives to the items that are made of many."""
    settings = machine.settings.changed(
        {
            "gate.window_samples": tables.WINDOW_SAMPLES,
            "gate.threshold_nat": tables.THRESHOLD_NAT,
        }
    )
    campaign = replay_simulated(scenario, machine.model_copy(update={"settings": settings}))
    given: dict[str, pl.DataFrame] = {}
    if "table2" in wanted:
        given["table2"] = pl.concat(_fits(scenario, machine, campaign))
    if "table3" in wanted:
        given["table3"] = _over(campaign, "threshold_nat", paper.TABLE_3_KG)
    if "table4" in wanted:
        windows = [round(samples) for samples in paper.TABLE_4_KG]
        given["table4"] = _over(campaign, "window_samples", windows)
    if {"fig6", "fig7", "fig8"} & set(wanted):
        given["loads"] = figures.loads_of(campaign)
    if "claims" in wanted:
        given["claims"] = claims.campaign_claims(campaign)
    return given


def _fits(scenario: Scenario, machine: Machine, ideal: Campaign) -> Iterator[pl.DataFrame]:
    """The lines of (19) with an ideal torque chain, and with one that would explain Table 2."""
    # (17) as printed knows no share of the force
    printed = machine.machine.model_copy(update={"force_share": 1.0})
    as_printed = machine.model_copy(update={"machine": printed})
    front = replay_simulated(scenario, as_printed, lambda log: through(log, TorqueChain()))
    for chain, campaign in (("ideal", ideal), ("front_axle", front)):
        yield (
            calibrate(campaign.estimates())
            .group_by("method", maintain_order=True)
            .agg(pl.lit(chain).alias("chain"), pl.col("alpha_1", "beta_kg").first())
        )


def _over(campaign: Campaign, setting: str, values: Collection[float]) -> pl.DataFrame:
    """The errors of a campaign over the values of a setting."""
    frames: list[pl.DataFrame] = []
    for value in values:
        settings = campaign.settings.changed({f"gate.{setting}": value})
        again = judged_anew(campaign, settings)
        frames.append(
            errors(again).with_columns(
                pl.lit(float(value)).alias(setting), bound_kg=pl.lit(run_bound_kg(again))
            )
        )
    return pl.concat(frames)


def _turning(machine: Machine) -> Machine:
    """The machine with a yaw acceleration, for rotational motions."""
    channels = {**machine.channels, "yaw_acc_rad_s2": Channel(derive="d/dt yaw_rate_rad_s")}
    return machine.model_copy(update={"channels": channels})


def _short(scenario: Scenario) -> Scenario:
    """One run without load."""
    campaign = scenario.campaign.model_copy(update={"loads_kg": (0.0,), "runs": 1})
    return scenario.model_copy(update={"campaign": campaign})


def _cruises(
    scenario: Scenario, machine: Machine, trials: int, seed: int, on_stage: Callable[[str], None]
) -> dict[str, list[float]]:
    """Errors of RLS at the end of long cruises, by how it was fed."""
    short = _short(scenario)
    cruise = short.campaign.model_copy(update={"cruise_s": claims.CRUISE_S})
    long = short.model_copy(update={"campaign": cruise})
    found: dict[str, list[float]] = {}
    for number in range(_cruise_count(trials)):
        on_stage(f"cruise {number + 1}")
        campaign = replay_simulated(seeded(long, seed + number), machine)
        for how in ("ungated", "gated"):
            found.setdefault(how, []).append(claims.cruise_error_kg(campaign, how))
        directional = claims.cruise_error_kg(campaign, "gated", directional=True)
        found.setdefault("gated, forgetting directionally", []).append(directional)
        directional = claims.cruise_error_kg(campaign, "ungated", directional=True)
        found.setdefault("ungated but forgetting directionally", []).append(directional)
    return found


def _cruise_count(trials: int) -> int:
    return max(trials // _TRIALS_A_CRUISE, 2)
