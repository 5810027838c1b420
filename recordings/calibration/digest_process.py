"""Digest untrusted files in a separate process with limits, and print their contents as JSON.

Started by `untrusted_files`:

python -m recordings.calibration.digest_process {recording|pdf} FILE…
"""

import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

#: Bytes of memory: a long log's recording takes one GiB.
_MOST_MEMORY: Final = 8 << 30
#: Seconds of processor: a long log's recording takes minutes.
_MOST_CPU_S: Final = 600
#: Characters of a fault that are passed on.
_LONGEST: Final = 200
#: Pages of a PDF; a report has a dozen.
_MOST_PAGES: Final = 500
#: What ends a page: its number of how many.
_COUNTER: Final = re.compile(r"\d+\s*/\s*\d+\s*\Z")


def main() -> None:
    """Digest recordings or extract words of PDFs, by the first argument; the others are files."""
    _limit_memory_and_processor_time()
    file_type, *files = sys.argv[1:]
    sys.stdout.write(json.dumps(digest_files(file_type, map(Path, files))))


def digest_files(file_type: str, files: Iterable[Path]) -> list[dict[str, Any]]:
    """Digest recordings or extract words of PDFs."""
    read = {"recording": _digest_recording, "pdf": extract_words_or_fault_of_pdf}[file_type]
    return [read(each) for each in files]


def _digest_recording(path: Path) -> dict[str, Any]:
    """Digests of inputs, settings and frames of a recording."""
    from estimators.errors import RecordingError
    from recordings.rrd.reader import read_recording

    try:
        run = read_recording(path, stored_names=True).with_fingerprint()
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


def extract_words_or_fault_of_pdf(path: Path) -> dict[str, Any]:
    """Words of a PDF, or the fault that makes it unreadable, as the reader's JSON output."""
    from pypdf import PdfReader
    from pypdf.errors import PyPdfError

    try:
        pages = PdfReader(path, strict=False).pages
        if len(pages) > _MOST_PAGES:
            return {"fault": f"has more than {_MOST_PAGES} pages"}
        texts = [_COUNTER.sub("", page.extract_text()) for page in pages]
    except (PyPdfError, ValueError, KeyError, TypeError, RecursionError, MemoryError) as fault:
        return {"fault": f"cannot be read ({type(fault).__name__}: {str(fault)[:_LONGEST]})"}
    return {"words": [word for text in texts for word in text.split()]}


def _limit_memory_and_processor_time() -> None:
    """Bound memory and time, where the system can."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MEMORY, _MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (_MOST_CPU_S, _MOST_CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main()
