"""A `Loss`: data missing from a log; kept apart so that readers import nothing else."""

from dataclasses import dataclass, fields

from estimators.errors import join_to_one_line


# no pydantic: importing it takes as long as opening a log does
@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """A loss: recorded data that is missing, altered or no longer provably there.

    `what` describes it in a sentence; `topic` is empty for a whole file.
    """

    source: str
    topic: str = ""
    what: str

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(self, each.name, join_to_one_line(getattr(self, each.name)))

    def __str__(self) -> str:
        """Source, topic and description of the loss, as one line."""
        return f"{' '.join(filter(None, (self.source, self.topic)))}: {self.what}"
