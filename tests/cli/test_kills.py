"""Commands killed with SIGKILL at random moments; the study of 200 kills is tests/studies/kill_study.py."""

from __future__ import annotations

import random
import sys

import pytest
from kill_episodes import COMMANDS, episode, undisturbed


@pytest.mark.skipif(sys.platform == "win32", reason="kills by signal")
@pytest.mark.parametrize("command", COMMANDS)
def test_killed_commands_lose_and_double_nothing(tmp_path, tiny_scene, command):
    n = 1 if command == "report" else 2
    expected, seconds = undisturbed(command, tiny_scene, tmp_path / "calm", n)
    # A command that is done before its moment comes counts for nothing: kill early enough.
    half = 0.5 * min(seconds)
    found = episode(command, tiny_scene, tmp_path / "killed", n, random.Random(8), expected, half, max_kills=2)
    assert sum(kill.alive for kill in found.kills) == 2
