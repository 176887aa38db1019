"""Settings of all tests: hypothesis tries the same examples every time, and no example fails for being slow.

Whoever runs them may have a narrow terminal: its width is nothing to the tests, but to those that set one.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from functools import cache

import pytest
import typer.testing
from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
os.environ.pop("COLUMNS", None)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # workers, one a core: threads of theirs would only wait
# A data base waits for its disk at each change, on a slow one for most of the time of the tests: memory does not.
if "TMPDIR" not in os.environ and os.path.isdir("/dev/shm") and shutil.disk_usage("/dev/shm").free > 4e9:
    os.environ["TMPDIR"] = tempfile.tempdir = "/dev/shm"
typer.testing._get_command = cache(typer.testing._get_command)  # made anew it takes longer than most commands


@pytest.fixture(scope="module")
def few_draws() -> Iterator[None]:
    """A compromise of few draws: those of a process take seconds, and are tested where they are the subject."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seqrsm.analysis.compromise.DRAWS", 20)
        yield


@pytest.fixture
def least_squares_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No process beside the polynomial, whatever the scores favour."""
    monkeypatch.setattr("seqrsm.analysis.belief.PRIOR_LOG_ODDS", -100.0)
