"""Collect losses as sentences, for several files or for one with many damaged places."""

from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Final

from analysis.model.loss import Loss

#: Most sentences that are listed; further ones are only counted.
_MOST_SENTENCES: Final = 100


class LossList(list[Loss]):
    """List of distinct losses."""

    def add_loss(self, source: Path, sentence: str, topic: str = "") -> None:
        """Add a loss unless it is already listed."""
        loss = Loss(source=source.name, topic=topic, what=sentence)
        if loss not in self:
            self.append(loss)


class FileDamage:
    """Damage found in one file; each sentence is kept once."""

    def __init__(self, source: str) -> None:
        self._source = source
        #: topic and sentence
        self._sentences: dict[tuple[str, str], None] = {}

    def add_damage_sentence(self, sentence: str, topic: str = "") -> None:
        """Add a sentence about damage, unless it is there already."""
        self._sentences[topic, sentence] = None

    def __bool__(self) -> bool:
        return bool(self._sentences)

    def list_losses(self, topic_of_connection: Mapping[int, str]) -> tuple[Loss, ...]:
        """All damage as losses; `topic_of_connection` gives the topic of each connection."""
        return tuple(
            Loss(source=self._source, topic=topic, what=what)
            for topic, what in [
                *self._iter_located_damage(topic_of_connection),
                *self._iter_topics_and_sentences(),
            ]
        )

    def _iter_located_damage(
        self,
        topic_of_connection: Mapping[int, str],  # noqa: ARG002 - for formats that keep track of places
    ) -> Iterator[tuple[str, str]]:
        """Yield topic and sentence of damage at known positions in the file; none in this class."""
        return iter(())

    def _iter_topics_and_sentences(self) -> Iterator[tuple[str, str]]:
        yield from islice(self._sentences, _MOST_SENTENCES)
        more = len(self._sentences) - _MOST_SENTENCES
        if more > 0:
            yield "", f"{more:,} more places are damaged like these"
