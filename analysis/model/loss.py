"""A `Loss`: what a log does not give. Readers of logs need this word of the model alone."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict

from estimators.errors import one_line

OneLine = Annotated[str, AfterValidator(one_line)]


class Loss(BaseModel):
    """What was recorded and is missing, altered or not provably there, in a sentence.

    `topic` is empty for a whole file.
    """

    model_config = ConfigDict(frozen=True)

    source: OneLine
    topic: OneLine = ""
    what: OneLine

    def __str__(self) -> str:
        """The sentence, after where it happened."""
        return f"{' '.join(filter(None, (self.source, self.topic)))}: {self.what}"
