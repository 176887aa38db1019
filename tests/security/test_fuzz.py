"""A few thousand spoilt inputs for every reader; the study of 100,000 is tests/studies/fuzz_study.py."""

from __future__ import annotations

import sys

import pytest
from fuzzing import fuzz, spoilt, targets

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="alarms by signal"),
    pytest.mark.filterwarnings("ignore"),  # of numpy and tifffile, on what they were given
]
INPUTS = {"toml": 400, "csv": 800, "expression": 1500, "npz": 250, "geotiff": 500, "legend": 200, "sigma0": 200}


@pytest.mark.parametrize("name", INPUTS)
def test_spoilt_files_are_refused_with_a_word(tmp_path, name):
    target = targets(tmp_path)[name]
    for data in target.seeds:
        target.read(data, tmp_path)  # what the fuzzing begins with is right
    tally = fuzz(target, tmp_path, range(INPUTS[name]))
    told = "\n".join(f"seed {seed}: {what}\n{spoilt(target, seed)[:300]!r}" for seed, what in tally.failures[:5])
    assert not tally.failures, told
    assert 0 < tally.refused < tally.inputs  # some spoilt inputs are still good, most are not
