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
    # A command that is done before its moment comes counts for nothing, and on a busy machine the time that it takes
    # says little: kill ever earlier until two were killed at work.
    for attempt in range(8):
        step_s, killed = min(seconds) / 2.0 ** (1 + attempt), tmp_path / f"killed {attempt}"
        found = episode(command, tiny_scene, killed, n, random.Random(8), expected, step_s, max_kills=2)
        if sum(kill.alive for kill in found.kills) == 2:
            return
    pytest.fail(f"not killed twice at work: {found.kills}")
