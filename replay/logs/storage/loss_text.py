"""Losses in sentences: of several files, and of one that may be damaged in many places."""

from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Final

from analysis.model.loss import Loss

#: More sentences than this are counted, not listed.
_MOST_SENTENCES: Final = 100


class LossList(list[Loss]):
    """Losses, each once: a damaged chunk that is met twice is one loss."""

    def note(self, source: Path, what: str, topic: str = "") -> None:
        """Add a loss unless it is there already."""
        loss = Loss(source=source.name, topic=topic, what=what)
        if loss not in self:
            self.append(loss)


class Damage:
    """What was found damaged in one file so far; each place once, however often it is met."""

    def __init__(self, source: str) -> None:
        self._source = source
        #: topic and sentence
        self._sentences: dict[tuple[str, str], None] = {}

    def note(self, what: str, topic: str = "") -> None:
        """Add a sentence."""
        self._sentences[topic, what] = None

    def __bool__(self) -> bool:
        return bool(self._sentences)

    def losses(self, topics: Mapping[int, str]) -> tuple[Loss, ...]:
        """List all of it; `topics` gives the topic of a connection."""
        return tuple(
            Loss(source=self._source, topic=topic, what=what)
            for topic, what in [*self._of_places(topics), *self._iter_sentences()]
        )

    def _of_places(self, topics: Mapping[int, str]) -> Iterator[tuple[str, str]]:  # noqa: ARG002 - for formats that keep track of places
        """Topic and sentence of what is known by its place in the file; nothing here."""
        return iter(())

    def _iter_sentences(self) -> Iterator[tuple[str, str]]:
        yield from islice(self._sentences, _MOST_SENTENCES)
        more = len(self._sentences) - _MOST_SENTENCES
        if more > 0:
            yield "", f"{more:,} more places are damaged like these"
