"""Started by `strange_files` as a process of its own: recordings in, digests as JSON out."""

import json
import sys
from pathlib import Path
from typing import Any, Final

from recordings.calibration.process_bounds import bound_process

_LONGEST: Final = 200


def main() -> None:
    """Digest the recordings that the command line names."""
    bound_process()
    sys.stdout.write(json.dumps([_digested(Path(each)) for each in sys.argv[1:]]))


def _digested(path: Path) -> dict[str, Any]:
    from estimators.errors import RecordingError
    from recordings.rrd.reader import read_recording

    try:
        run = read_recording(path).with_fingerprint()
    except RecordingError as fault:
        return {"fault": f"cannot be read ({str(fault)[-_LONGEST:]})"}
    taken = run.provenance.fingerprint
    assert taken is not None
    return {
        "inputs": [each.sha256 for each in run.provenance.inputs],
        "settings": taken.settings,
        "results": taken.results,
        "frames": taken.frames,
        "notes": list(run.provenance.notes),
    }


if __name__ == "__main__":
    main()
