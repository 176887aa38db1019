"""Settings of all tests: hypothesis tries the same examples every time, and no example fails for being slow.

Whoever runs them may have a narrow terminal: its width is nothing to the tests, but to those that set one.
"""

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
os.environ.pop("COLUMNS", None)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # workers, one a core: threads of theirs would only wait


@pytest.fixture(scope="module")
def few_draws() -> Iterator[None]:
    """A compromise of few draws: those of a process take seconds, and are tested where they are the subject."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seqrsm.analysis.compromise.DRAWS", 20)
        yield
