"""Started by `strange_files` as a process of its own: a PDF in, its words as JSON out."""

import json
import re
import sys
from typing import Final

from recordings.calibration.process_bounds import bound_process

_MOST_PAGES: Final = 500
#: What ends a page: its number of how many.
_COUNTER: Final = re.compile(r"\d+\s*/\s*\d+\s*\Z")


def main() -> None:
    """Read the words of the PDF that the command line names."""
    bound_process()
    from pypdf import PdfReader
    from pypdf.errors import PyPdfError

    try:
        pages = PdfReader(sys.argv[1], strict=False).pages
        if len(pages) > _MOST_PAGES:
            said: dict[str, object] = {"fault": f"has more than {_MOST_PAGES} pages"}
        else:
            texts = [_COUNTER.sub("", page.extract_text()) for page in pages]
            said = {"words": [word for text in texts for word in text.split()]}
    except (PyPdfError, ValueError, KeyError, TypeError, RecursionError, MemoryError) as fault:
        said = {"fault": f"cannot be read ({type(fault).__name__}: {str(fault)[:200]})"}
    sys.stdout.write(json.dumps([said]))


if __name__ == "__main__":
    main()
