"""Settings of all tests: hypothesis tries the same examples every time, and no example fails for being slow.

Whoever runs them may have a narrow terminal: its width is nothing to the tests, but to those that set one.
"""

import os

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
os.environ.pop("COLUMNS", None)
