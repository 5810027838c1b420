"""A report in words: for terminals, and for the page of a recording that grows."""

from datetime import UTC, datetime

from analysis.online.answer_progress import missing_text
from analysis.online.online_report import OnlineReport


def time_text(unix_ns: int) -> str:
    """The time of day as UTC, to a tenth of a second."""
    at = datetime.fromtimestamp(unix_ns // 10**9, UTC)
    return f"{at:%H:%M:%S}.{unix_ns % 10**9 // 10**8}"


def mass_text(report: OnlineReport) -> str:
    """Mass and friction with their uncertainties, or why there is none."""
    if report.mass_kg is None:
        return report.validity.replace("_", " ")
    return (
        f"{report.mass_kg:,.1f} ± {report.mass_u_kg:,.1f} kg, friction "
        f"{report.friction_x_N_s_m:,.0f} ± {report.friction_u_N_s_m:,.0f} N·s/m, {report.validity}"
    )


def progress_text(report: OnlineReport) -> str:
    """How far from an answer, and what is missing; empty where nothing says how sure to be."""
    if report.until_u_kg is None or report.percent is None:
        return ""
    missing = missing_text(report.starts_missing, report.reverse_missing)
    rest = f"; missing: {missing}" if missing else ""
    if report.load_mass_kg is None or report.load_u_kg is None:
        return f"0 % to ± {report.until_u_kg:,.3g} kg{rest}"
    return (
        f"{report.percent:.0f} % to ± {report.until_u_kg:,.3g} kg: load of now "
        f"{report.load_mass_kg:,.1f} ± {report.load_u_kg:,.1f} kg from "
        f"{report.load_manoeuvres:,}{rest}"
    )


def page_text(report: OnlineReport) -> str:
    """The same in Markdown, for the page beside the plots."""
    age = "" if report.age_s is None else f", {report.age_s:,.0f} s old"
    return (
        f"# {mass_text(report)}\n\n"
        f"Last manoeuvre{age}; {report.manoeuvres:,} gave a mass so far.\n\n"
        f"{progress_text(report)}\n\n"
        f"{time_text(report.unix_ns)} UTC: {report.phase or 'unknown'}, gate "
        f"{report.gate.replace('_', ' ')}.\n\n"
        "Recorded as it is followed: random uncertainties, no load states. When the log ends, its "
        "causal replay takes the place of this recording.\n"
    )
