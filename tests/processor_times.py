"""Which files and tests took most of the processor: `make test-times`. pytest's cache has all.

Seconds of the processor, of a test with its fixtures and the processes that it waited for; what a
busy machine makes of them is less than what it makes of the clock. A fixture counts with the first
test that asks for it.
"""

import os
from collections import Counter
from collections.abc import Generator

import pytest

#: Files, and tests, that are listed.
MOST = 25
_SECONDS = "processor_s"


def processor_s() -> float:
    """Seconds of the processor that this process and those it waited for have used."""
    return sum(os.times()[:4])


class ProcessorTimes:
    """Counts in each worker, adds up and prints where the workers report to."""

    def __init__(self) -> None:
        self._before_s = processor_s()
        self._by_file: Counter[str] = Counter()
        self._by_test: Counter[str] = Counter()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self,
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        before_s, self._before_s = self._before_s, processor_s()
        report.user_properties.append((_SECONDS, self._before_s - before_s))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        seconds = dict(report.user_properties).get(_SECONDS, 0.0)
        assert isinstance(seconds, float)
        self._by_file[report.nodeid.partition("::")[0]] += seconds
        self._by_test[report.nodeid] += seconds

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        terminalreporter.section("seconds of the processor")
        for counted in (self._by_file, self._by_test):
            for name, seconds in counted.most_common(MOST):
                terminalreporter.line(f"{seconds:7.1f}  {name}")
            terminalreporter.line(f"{counted.total():7.1f}  all")
        cache = terminalreporter.config.cache
        if cache is not None:
            cache.set("payscope/processor_s", dict(self._by_test.most_common()))
