"""Started by `strange_files` as a process of its own: a recording in, its digests as JSON out."""

import json
import sys
from pathlib import Path

from recordings.calibration.process_bounds import bound_process


def main() -> None:
    """Digest the recording that the command line names."""
    bound_process()
    from estimators.errors import RecordingError
    from recordings.rrd.reader import read_recording

    try:
        run = read_recording(Path(sys.argv[1])).fingerprinted()
    except RecordingError as fault:
        said: dict[str, object] = {"fault": f"cannot be read ({str(fault)[-200:]})"}
    else:
        taken = run.provenance.fingerprint
        assert taken is not None
        said = {
            "inputs": [each.sha256 for each in run.provenance.inputs],
            "settings": taken.settings,
            "results": taken.results,
            "frames": taken.frames,
            "notes": list(run.provenance.notes),
        }
    sys.stdout.write(json.dumps(said))


if __name__ == "__main__":
    main()
