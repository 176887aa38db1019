"""A new campaign folder is whole, or it is made anew."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

import pytest

from seqrsm.spec.templates import copy_template


@pytest.mark.skipif(sys.platform == "win32", reason="forks")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("there", [False, True])
@pytest.mark.parametrize("killed", [False, True])
def test_a_folder_that_init_left_unfinished_is_made_anew(tmp_path, there, killed):
    """Killed, or the disk full, before each of its files comes to its place."""
    copy_template("flevoland", tmp_path / "whole")
    whole = sorted(path.name for path in (tmp_path / "whole").iterdir())
    real = Path.replace
    for moment in range(10):
        again = tmp_path / f"again{moment}"
        if there:
            again.mkdir()
        left = [moment]

        def replace(self, target, left=left):
            left[0] -= 1
            if left[0] < 0 and killed:
                os._exit(9)
            if left[0] < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return real(self, target)

        child = os.fork()
        if child == 0:
            Path.replace = replace
            try:
                copy_template("flevoland", again)
                os._exit(0)
            finally:
                os._exit(9)
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        assert (again / "campaign.toml").exists() is (ended == 0)
        if ended == 0:
            break
        copy_template("flevoland", again)
        assert sorted(path.name for path in again.iterdir()) == whole
        assert not (again / ".init").exists()
    assert moment > 0
