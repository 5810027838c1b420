"""Run the commands in the documentation and put their real output below them.

    python -P docs/update.py            rewrite README.md and docs/*.md
    python -P docs/update.py --quick    rewrite tables of settings and keys, and help, alone
    python -P docs/update.py --check    exit 1 when what is written is not what comes out
    python -P docs/update.py --check README.md      the same of this page and those before it

A block begins with ```console; each line `$ payscope …` in it is run in one temporary folder, page
after page, so that a page may use what one before it made. Numbers may differ by 1 % between
machines before a check fails.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from pydantic import BaseModel

from analysis.calibration.campaign.campaign_plan import (
    CampaignLimits,
    CampaignMethod,
    CampaignRun,
    LeftOutLog,
    NotaryStretch,
    StatedComponent,
)
from analysis.calibration.campaign.campaign_subjects import (
    CalibratedMachine,
    Conditions,
    EvidenceSubject,
    Organisation,
    ReferenceMass,
)
from analysis.model.settings import Settings
from analysis.simulation.scenario.drivetrain import (
    SimulatedBrakes,
    SimulatedChassis,
    SimulatedDrivetrain,
    SimulatedRolling,
)
from analysis.simulation.scenario.instruments import (
    SimulatedDefects,
    SimulatedRecorder,
    SimulatedSampling,
    SimulatedSensors,
)
from analysis.simulation.scenario.manoeuvres import Arc, Excite, Rest, Spin, Start, Travel
from analysis.simulation.scenario.scenario import (
    SimulatedCampaign,
    SimulatedLoading,
    SimulatedMachine,
    SimulatedStarts,
    SimulatedTerrain,
)
from analysis.simulation.scenario.shift_plan import SimulatedShift
from analysis.simulation.scenario.waveforms import ForceWave, TorqueWave
from replay.fleet.last_run import TaskLimits
from replay.fleet.machine_setups import FleetSection, MachineRule

REPO = Path(__file__).resolve().parent.parent
PAGES = (
    REPO / "README.md",
    *(
        REPO / "docs" / f"{name}.md"
        for name in (
            "first-recording",
            "loads",
            "explaining",
            "from-your-own-table",
            "machine-file",
            "simulating",
            "reviewing-a-shift",
            "inertia-and-centre-of-mass",
            "evidence",
            "fleet",
            "on-board",
            "commands",
        )
    ),
)
_BLOCK = re.compile(r"```console\n(.*?)```", re.DOTALL)
_SETTINGS = re.compile(r"(<!-- settings -->).*?(<!-- end of settings -->)", re.DOTALL)
_CAMPAIGN = re.compile(r"(<!-- campaign -->).*?(<!-- end of campaign -->)", re.DOTALL)
_FLEET = re.compile(r"(<!-- fleet file -->).*?(<!-- end of fleet file -->)", re.DOTALL)
_SCENARIO = re.compile(r"(<!-- scenario -->).*?(<!-- end of scenario -->)", re.DOTALL)
#: Another processor gives other last bits; evidence has a name of its own each time.
_DIGEST = re.compile(
    r"\b[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}\b|\b(?=[0-9a-f]*[0-9])[0-9a-f]{12}\b"
)
_COMPILING = "payscope: compiling "
_NUMBER = re.compile(r"[-+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?")


def updated(page: str, folder: Path) -> str:
    """The page with the output of its commands, and its tables, as they are now."""
    return _BLOCK.sub(
        lambda block: f"```console\n{_run_block(block[1], folder)}```", with_tables(page)
    )


def with_tables(page: str) -> str:
    """The page with its tables of settings and keys as they are now."""
    page = _SETTINGS.sub(lambda found: f"{found[1]}\n{settings_table()}\n{found[2]}", page)
    page = _SCENARIO.sub(lambda found: f"{found[1]}\n{scenario_tables()}\n{found[2]}", page)
    page = _FLEET.sub(lambda found: f"{found[1]}\n{fleet_tables()}\n{found[2]}", page)
    return _CAMPAIGN.sub(lambda found: f"{found[1]}\n{campaign_tables()}\n{found[2]}", page)


def settings_table() -> str:
    """Every setting with its default and meaning, from where it is declared."""
    rows = ["| setting | default | meaning |", "|---|---|---|"]
    for part, model in Settings.list_stage_models().items():
        for name, field in model.model_fields.items():
            default = json.dumps(field.default)
            rows.append(f"| `{part}.{name}` | `{default}` | {field.description or ''} |")
    return "\n".join(rows)


def scenario_tables() -> str:
    """Every key of a scenario file with its default and meaning, a table a section."""
    sections: list[tuple[str, type[BaseModel]]] = [
        (f"`[{name}]`", model)
        for name, model in (
            ("machine", SimulatedMachine),
            ("campaign", SimulatedCampaign),
            ("terrain", SimulatedTerrain),
            ("rolling", SimulatedRolling),
            ("drivetrain", SimulatedDrivetrain),
            ("chassis", SimulatedChassis),
            ("brakes", SimulatedBrakes),
            ("starts", SimulatedStarts),
            ("loading", SimulatedLoading),
            ("sensors", SimulatedSensors),
            ("sampling", SimulatedSampling),
            ("defects", SimulatedDefects),
            ("log", SimulatedRecorder),
            ("shift", SimulatedShift),
        )
    ]
    for kind in (Rest, Start, Spin, Arc, Excite, Travel):
        name = kind.model_fields["kind"].default
        sections.append((f'`[[campaign.manoeuvres]]` `kind = "{name}"`', kind))
    sections += [("`force` of an excitation", ForceWave), ("`torque`", TorqueWave)]
    return _tables(sections)


def campaign_tables() -> str:
    """Every key of a campaign file of a calibration, a table a section."""
    return _tables(
        [
            ("`[campaign]`", EvidenceSubject),
            ("`[laboratory]` and `[customer]`", Organisation),
            ("`[machine]`", CalibratedMachine),
            ("`[[masses]]`", ReferenceMass),
            ("`[conditions]`", Conditions),
            ("`[[runs]]`", CampaignRun),
            ("`[method]`", CampaignMethod),
            ("`[[method.stated]]`", StatedComponent),
            ("`[decision]`", CampaignLimits),
            ("`[notary]`", NotaryStretch),
            ("`[[notary.left_out]]`", LeftOutLog),
        ]
    )


def fleet_tables() -> str:
    """Every key of a fleet file, a table a section."""
    return _tables(
        [("`[fleet]`", FleetSection), ("`[limits]`", TaskLimits), ("`[[machines]]`", MachineRule)]
    )


def _tables(sections: list[tuple[str, type[BaseModel]]]) -> str:
    lines: list[str] = []
    for title, model in sections:
        lines += ["", f"**{title}** {' '.join((model.__doc__ or '').split())}", ""]
        lines += ["| key | default | meaning |", "|---|---|---|"]
        for name, field in model.model_fields.items():
            if name != "kind":
                default = "–" if field.is_required() else f"`{_written(field.default)}`"
                lines.append(f"| `{name}` | {default} | {field.description} |")
    return "\n".join([*lines[1:], ""])


def _written(default: object) -> str:
    """A default as TOML or JSON writes it; that of a table by its name."""
    return "{}" if isinstance(default, BaseModel) else json.dumps(default)


def same(written: str, now: str) -> bool:
    """Whether two pages agree: numbers to 1 %, digests whatever they are."""
    written, now = (_DIGEST.sub("digest", page) for page in (written, now))
    if _NUMBER.sub("#", written).split() != _NUMBER.sub("#", now).split():
        return False
    pairs = zip(_NUMBER.findall(written), _NUMBER.findall(now), strict=True)
    return all(_close(_value(a), _value(b)) for a, b in pairs)


def _value(number: str) -> float:
    return float(number.replace(",", ""))


def _close(a: float, b: float) -> bool:
    return abs(a - b) <= max(0.01 * max(abs(a), abs(b)), 0.11)


def _run_block(block: str, folder: Path) -> str:
    commands = [line for line in block.splitlines() if line.startswith("$ ")]
    return "".join(f"{line}\n{_output(line[2:], folder)}" for line in commands)


def _output(command: str, folder: Path) -> str:
    scripts = str(Path(sys.executable).parent)
    left = subprocess.run(
        command,
        shell=True,
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
        env={
            **os.environ,
            "PATH": f"{scripts}:{os.environ['PATH']}",
            "COLUMNS": "96",
            "TERM": "dumb",
            "NO_COLOR": "1",
            # that of whoever runs this vouches for nothing on these pages
            "PAYSCOPE_KEYRING": "keys.toml",
        },
    )
    if left.returncode not in (0, 1, 2):
        raise SystemExit(f"{command}: exit status {left.returncode}\n{left.stdout}")
    lines = (line.rstrip() for line in left.stdout.rstrip().splitlines())
    # what is said while compiling is said once an installation
    return "\n".join(line for line in lines if not line.startswith(_COMPILING)) + "\n"


def main(check: bool, last: str | None = None) -> int:
    """Update or check the pages up to `last`; the number of pages that differ when checking."""
    differ = 0
    names = [page.name for page in PAGES]
    if last is not None and last not in names:
        raise SystemExit(f"{last}: no such page; choices: {', '.join(names)}")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "examples").symlink_to(REPO / "examples")
        for page in PAGES[: names.index(last) + 1 if last else None]:
            written = page.read_text(encoding="utf-8")
            now = updated(written, Path(folder))
            if not check:
                page.write_text(now, encoding="utf-8")
            elif not same(written, now):
                differ += 1
                print(f"{page}: the output written there is not what comes out; run `make docs`")
    return differ


def write_tables_and_help() -> int:
    """Write tables of settings and keys, and blocks of nothing but help, into their pages; 0."""

    def with_help(block: re.Match[str]) -> str:
        commands = [line for line in block[1].splitlines() if line.startswith("$ ")]
        if not all(line.endswith(" --help") for line in commands):
            return block[0]
        return f"```console\n{_run_block(block[1], REPO)}```"

    for page in PAGES:
        written = with_tables(page.read_text(encoding="utf-8"))
        page.write_text(_BLOCK.sub(with_help, written), encoding="utf-8")
    return 0


if __name__ == "__main__":
    _words = sys.argv[1:]
    if "--quick" in _words:
        sys.exit(write_tables_and_help())
    sys.exit(main("--check" in _words, *(word for word in _words if word != "--check")))
