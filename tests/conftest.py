"""Fixtures that are slow to make and that no test changes."""

import re
import signal

import pytest
from hypothesis import settings

from sim.cli import main, plan_command
from sim.scenario import Scenario, prepare

settings.register_profile("suite", deadline=None, derandomize=True, database=None)  # the same examples every time
settings.load_profile("suite")


def pytest_addoption(parser: pytest.Parser) -> None:
    """What is asked of the suite beside what pytest knows."""
    parser.addoption("--full", action="store_true", help="also tests that are marked slow")
    parser.addoption("--thorough", action="store_true", help="also tests that say the same of more scenes and systems")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked slow without `--full`, and what is marked thorough without `--thorough`."""
    out = [mark for mark, option in (("slow", "full"), ("thorough", "thorough")) if not config.getoption(option)]
    left = [item for item in items if any(item.get_closest_marker(mark) for mark in out)]
    config.hook.pytest_deselected(items=left)
    items[:] = [item for item in items if item not in set(left)]


@pytest.fixture(scope="session", autouse=True)
def _interruptions_reach_children() -> None:
    """A suite that a shell started in the background, or by `nohup`, would hand on that Ctrl-C is ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _compiling_is_known() -> None:
    """Tests that count lines find the same, whether kernels have been compiled or not."""
    plan_command.notice().reported = True


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]):
    """Assert that a command has status 2 and costs one line, in which some words are, and prints nothing before."""

    def refused(words: list[str], *reasons: str, quiet: bool = True) -> None:
        capsys.readouterr()
        assert main(words) == 2
        said = capsys.readouterr()
        assert not (quiet and said.out)
        assert re.fullmatch("pirrht: .*\n", said.err)
        for reason in reasons:
            assert reason in said.err

    return refused


@pytest.fixture(scope="session")
def slit() -> Scenario:
    """The scene `slit` under its own settings."""
    return prepare("slit")


@pytest.fixture(scope="session")
def slit_tree(slit: Scenario):
    """A tree of 1000 vertices in it; tests ask, and do not grow it."""
    return slit.grown_tree()
