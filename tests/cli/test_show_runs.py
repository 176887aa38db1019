"""What `simulate` says of the runs that it carried out."""

from types import SimpleNamespace
from typing import Any

import pytest

from seqrsm.cli.show import show_runs


def test_failed_runs_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    spec: Any = SimpleNamespace(factors=())
    score = SimpleNamespace(application="a", score=1.0)
    good: Any = SimpleNamespace(run_id=1, state="scored", scores=(score,), reason="", settings={})
    bad: Any = SimpleNamespace(run_id=2, state="failed", scores=(), reason="no scene", settings={})
    show_runs(spec, [good, bad, bad])
    assert capsys.readouterr().out.splitlines()[-1] == "3 runs completed, 2 without a score"
    show_runs(spec, [good])
    assert capsys.readouterr().out.splitlines()[-1] == "1 run completed"
