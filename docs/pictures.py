"""Draw the documentation's pictures anew: python -P docs/pictures.py (needs a Vulkan driver)."""

import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path

from PIL import Image

from recordings import plot_run, write_recording
from recordings.rrd.viewer import take_screenshots_of_recording
from replay import load_machine, open_log, run
from replay.simulation.scenario_file import load_scenario_file
from replay.simulation.simulate_logs import simulate_scenario_to_logs

DOCS = Path(__file__).resolve().parent
IMAGES = DOCS / "images"
#: The tabs that the pages show.
TABS = {"Overview": "overview.png", "Gate": "gate.png"}


def main() -> None:
    """One log of the paper's campaign and all six: a page by `plot`, and tabs of the viewer."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        logs = simulate_scenario_to_logs(
            load_scenario_file(DOCS.parent / "examples/campaign.toml"), work / "campaign.bag"
        )
        with open_log(logs[3]) as log:
            result = run(log, load_machine("cat262c.toml"))
        plot_run(result, work / "page.png")
        shutil.copyfile(work / "page.png", IMAGES / "page.png")
        for shot in take_screenshots_of_recording(
            write_recording(result, work / "first.rrd"), work
        ):
            if shot.tab in TABS:
                shutil.copyfile(shot.png, IMAGES / TABS[shot.tab])
        with ExitStack() as opened:
            six = [opened.enter_context(open_log(log)) for log in logs]
            result = run(six, load_machine("cat262c.toml"))
        for shot in take_screenshots_of_recording(write_recording(result, work / "six.rrd"), work):
            if shot.tab == "Loads":
                shutil.copyfile(shot.png, IMAGES / "loads.png")
    for picture in IMAGES.glob("*.png"):
        # a palette is enough for lines, and a third of the size
        Image.open(picture).convert("RGB").quantize(128).save(picture, optimize=True)


if __name__ == "__main__":
    main()
