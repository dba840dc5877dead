"""The pytest plug-in: the cases of suites as tests.

::

    pytest --rvsg-suite suite/                 # every case of the suite is a test of its own

    def test_robot(rvsg_scenario):             # or your own test, called once for each case and requirement
        result = rvsg_scenario.run()
        assert not result.state.fails, result.story

Every case carries the marker `rvsg_requirement(NAME)`; `-m rvsg` selects them all. RVSG is imported when a suite is
given, not before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from rvsg.app.suites import Suite
    from rvsg.suites.suite import Case, CaseResult


@dataclass(frozen=True)
class SuiteScenario:
    """A case of a suite with one of its requirements, ready to run."""

    suite: Suite
    case: Case
    requirement: str

    def run(self, **options: Any) -> CaseResult:
        """Run the case and return its result for this requirement; `options` are those of `Suite.run`."""
        results = self.suite.run(only=(self.case.name,), **options).cases
        return next(result for result in results if result.requirement == self.requirement)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("rvsg")
    group.addoption("--rvsg-suite", action="append", default=[], metavar="DIR", help="Run the cases of this suite.")
    group.addoption("--rvsg-simulator", default=None, metavar="NAME", help="What runs the cases. [as found]")
    group.addoption("--rvsg-stack", default=None, metavar="NAME|FILE", help="Navigation stack under test.")


def pytest_configure(config: pytest.Config) -> None:
    """Register the markers, and the collection of suites where any is given."""
    config.addinivalue_line("markers", "rvsg: a case of a suite of RVSG")
    config.addinivalue_line("markers", "rvsg_requirement(name): the requirement that the case is judged by")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Call a test that takes `rvsg_scenario` once for each case and requirement."""
    if "rvsg_scenario" not in metafunc.fixturenames:
        return
    scenarios = list(_scenarios(metafunc.config))
    values = [pytest.param(each, id=_id(each), marks=_marks(each)) for each in scenarios]
    metafunc.parametrize("rvsg_scenario", values)


class SuiteItem(pytest.Item):
    """A case of a suite as a test of its own."""

    def __init__(self, *, scenario: SuiteScenario, **given: Any) -> None:
        super().__init__(**given)
        self.scenario = scenario
        for mark in _marks(scenario):
            self.add_marker(mark)

    def runtest(self) -> None:
        """Run the case; a broken one fails, a known failure or an unclear one is skipped with the reason."""
        from rvsg.suites.suite import State

        result = self.scenario.run(
            simulator=self.config.getoption("--rvsg-simulator"), stack=self.config.getoption("--rvsg-stack")
        )
        for name, value in (("state", result.state.value), ("verdict", result.verdict.status.value)):
            self.user_properties.append((name, value))
        said = f"{result.state.value}: {result.verdict.reason}"
        if result.state.fails:
            raise SuiteFailure("\n".join([said, *result.story]))
        if result.state in (State.KNOWN_FAILURE, State.UNCLEAR):
            pytest.skip(f"{said}. {result.reason}")

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Show what happened, without a traceback."""
        if isinstance(excinfo.value, SuiteFailure):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return where the case is from."""
        return self.path, None, self.name


class SuiteFailure(Exception):
    """A case that should pass violates its requirement."""


class SuiteFile(pytest.Collector):
    """A suite, whose cases are tests."""

    def collect(self) -> Iterator[pytest.Item]:
        """Yield a test for each case and requirement."""
        for each in _of(self.path):
            yield SuiteItem.from_parent(self, name=_id(each), scenario=each)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(session: pytest.Session, config: pytest.Config, items: list[pytest.Item]) -> None:
    """Add the cases of the suites that no test takes itself."""
    taken = any("rvsg_scenario" in getattr(item, "fixturenames", ()) for item in items)
    if taken:
        return
    for folder in config.getoption("--rvsg-suite"):
        collector = SuiteFile.from_parent(session, name=Path(folder).name, path=Path(folder).absolute())
        items.extend(collector.collect())


def _scenarios(config: pytest.Config) -> Iterator[SuiteScenario]:
    for folder in config.getoption("--rvsg-suite"):
        yield from _of(folder)


def _of(folder: str | Path) -> Iterator[SuiteScenario]:
    from rvsg.app.suites import Suite
    from rvsg.core.errors import RvsgError

    try:
        suite = Suite.open(folder)
    except RvsgError as error:
        raise pytest.UsageError(str(error)) from error
    for case in suite.cases:
        for expectation in case.expectations:
            yield SuiteScenario(suite, case, expectation.requirement)


def _id(each: SuiteScenario) -> str:
    return f"{each.case.name}-{each.requirement}"


def _marks(each: SuiteScenario) -> tuple[pytest.MarkDecorator, ...]:
    return pytest.mark.rvsg, pytest.mark.rvsg_requirement(each.requirement)
