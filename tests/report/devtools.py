"""Chromium by its DevTools protocol, over two pipes: a page is opened, a script in it answers."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
HEADLESS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars")


class Page:
    """A tab; messages are JSON with a zero byte behind each."""

    def __init__(self, to: int, from_: int) -> None:
        self._to, self._from, self._session, self._number, self._rest = to, from_, "", 0, b""
        self.heard: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.call("Page.enable")
        self.call("Page.setBypassCSP", enabled=True)  # the pages forbid all scripts but their own

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Result of a method of the protocol."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self._to, data) :]
        while (answer := self._next()).get("id") != self._number:
            self.heard.append(answer)
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            more = os.read(self._from, 1 << 20)
            assert more, "the browser has ended"
            self._rest += more
        text, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(text)
        return message

    def open(self, path: Path, width: int, *, dark: bool = False) -> None:
        """Open a file in a window of this width [px], and wait until it is there."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.heard.clear()
        self.call("Page.navigate", url=path.as_uri())
        while not any(one.get("method") == "Page.loadEventFired" for one in self.heard):
            self.heard.append(self._next())

    def run(self, script: str) -> Any:
        """Value of an expression, awaited where it is a promise."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")


@contextmanager
def tab(folder: Path, seconds: float = 300.0) -> Iterator[Page]:
    """A browser with its profile in ``folder``, as long as the block runs and no longer than ``seconds``."""
    assert BROWSER is not None
    theirs, to = os.pipe()
    from_, its = os.pipe()
    command = [BROWSER, *HEADLESS, "--remote-debugging-pipe", f"--user-data-dir={folder / 'profile'}"]
    # The protocol is spoken on descriptors 3 and 4.
    shell = ["timeout", str(seconds), "bash", "-c", f'exec "$@" 3<&{theirs} 4>&{its}', "bash", *command]
    browser = subprocess.Popen(shell, pass_fds=(theirs, its), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(theirs)
    os.close(its)
    try:
        page = Page(to, from_)
        yield page
    finally:
        os.close(to)
        os.close(from_)
        browser.terminate()
        browser.wait()
