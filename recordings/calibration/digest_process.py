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

#: Most bytes of memory: the recording of a long log takes one GiB.
_MOST_MEMORY: Final = 8 << 30
#: Most seconds of processor time: the recording of a long log takes minutes.
_MOST_CPU_S: Final = 600
#: Characters of a fault that are returned, at most.
_LONGEST: Final = 200
#: Most pages of a PDF; a report has a dozen.
_MOST_PAGES: Final = 500
#: End of a PDF as it was written at once; what is appended may draw over its pages.
_PDF_END: Final = b"%%EOF"
#: Text at the end of a page: its number and the number of pages.
_COUNTER: Final = re.compile(r"\d+\s*/\s*\d+\s*\Z")


def main() -> None:
    """Print digests of recordings or words of PDFs as JSON.

    The first argument says which, the others are the files.
    """
    _limit_memory_and_processor_time()
    file_type, *files = sys.argv[1:]
    sys.stdout.write(json.dumps(digest_files(file_type, map(Path, files))))


def digest_files(file_type: str, files: Iterable[Path]) -> list[dict[str, Any]]:
    """Digest recordings or extract words of PDFs, as JSON-compatible values for each file."""
    read = {"recording": _digest_recording, "pdf": extract_words_or_fault_of_pdf}[file_type]
    return [read(each) for each in files]


def _digest_recording(path: Path) -> dict[str, Any]:
    """Compute the digests of inputs, settings and frames of a recording."""
    from estimators.errors import RecordingError
    from recordings.rrd.reader import read_recording

    try:
        run = read_recording(path, stored_names=True).with_fingerprint()
    except RecordingError as fault:
        # without the path of the copy, and a remedy that is for one's own recording
        said = str(fault).removeprefix(f"{path}: ").partition(";")[0]
        return {"fault": f"cannot be read: {said[:_LONGEST]}; ask for the bundle as it was written"}
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
    """Extract the words of a PDF, or the fault that makes it unreadable, for the JSON output."""
    from pypdf import PdfReader
    from pypdf.errors import PyPdfError

    try:
        pages = PdfReader(path, strict=False).pages
        if len(pages) > _MOST_PAGES:
            return {"fault": f"has more than {_MOST_PAGES} pages"}
        texts = [_COUNTER.sub("", page.extract_text()) for page in pages]
    except (PyPdfError, ValueError, KeyError, TypeError, RecursionError, MemoryError) as fault:
        return {"fault": f"cannot be read ({type(fault).__name__}: {str(fault)[:_LONGEST]})"}
    _, _, after = path.read_bytes().partition(_PDF_END)
    if after.strip():
        what = f"has {len(after):,} bytes after its end, which cannot be compared"
        return {"fault": f"{what}; ask for the bundle as it was written"}
    return {"words": [word for text in texts for word in text.split()]}


def _limit_memory_and_processor_time() -> None:
    """Limit memory and processor time of this process, if the system supports it."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MEMORY, _MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (_MOST_CPU_S, _MOST_CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main()
