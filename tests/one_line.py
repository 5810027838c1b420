"""The one line that an error is, before `PayscopeError` folds whatever it was given into one."""

from estimators.errors import PayscopeError


def assert_one_line(error: BaseException) -> None:
    """It was written as one line, which a library's report or a traceback is not."""
    text = error.args[0] if isinstance(error, PayscopeError) else str(error)
    assert "\n" not in text, text
    assert "Traceback" not in text, text
