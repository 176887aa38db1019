"""The page of ``seqrsm plan``: one file that works offline, in which factors, budget, target and cost are moved."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from seqrsm.report.html import environment, template_text
from seqrsm.report.profile import profile_text
from seqrsm.report.wording import interval_names, readable

if TYPE_CHECKING:
    from seqrsm.analysis.results import Analysis


def render_plan(document: dict[str, Any], analyses: Sequence[Analysis]) -> str:
    """Render the plan of a campaign as one HTML page, with the profilers of what is fitted so far.

    Parameters
    ----------
    document : dict
        From `seqrsm.campaign.check.plan_campaign`.
    analyses : sequence of Analysis
        Empty before the first scores.
    """
    from markupsafe import Markup

    script = template_text("plan.js") + template_text("profiler.js")
    words = interval_names(document["replicates"])[document["interval"]]
    shown = {**document, "labels": [readable(name) for name in document["factors"]], "words": words}
    return (
        environment()
        .get_template("plan.html.j2")
        .render(
            plan=document,
            words=words,
            data=Markup(json.dumps(shown, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")),
            profiles=[{"name": one.application, "data": Markup(profile_text(one))} for one in analyses],
            style=Markup(template_text("style.css")),
            script=Markup(script),
            script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        )
    )
