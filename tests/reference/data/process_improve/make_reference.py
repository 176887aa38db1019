"""Random problems solved by process-improve (PyPI, version in the file), for tests/reference/test_process_improve.py.

    python -m venv V && V/bin/pip install process-improve && V/bin/python make_reference.py

Quadratic models of two to four numeric factors, some with a factor of three categories (contrasts that sum to zero),
some in blocks; settings are repeated, within blocks where there are any.
"""

import json
import warnings
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import process_improve.experiments as pi

ASKED = ["coefficients", "lack_of_fit", "prediction", "anova"]


def formula(names: list[str], category: bool, blocks: bool) -> str:
    terms = list(names)
    terms += [f"{a}:{b}" for i, a in enumerate(names) for b in names[i + 1 :]]
    terms += [f"I({a}**2)" for a in names]
    if category:
        terms += ["C(P, Sum)", *(f"C(P, Sum):{a}" for a in names)]
    return "y ~ " + " + ".join([*(["Block"] if blocks else []), *terms])


def problem(seed: int) -> dict:
    rng = np.random.default_rng(seed)
    names, category, blocks = list("EFGH")[: 2 + seed % 3], seed % 2 == 1, seed % 4 >= 2
    terms = len(names) * (len(names) + 3) // 2 + 1 + (2 + 2 * len(names)) * category
    n = terms + 8
    X = np.round(rng.uniform(-1, 1, (n, len(names))), 3)
    X[0], X[1] = -1.0, 1.0  # it codes by the ends of the data
    table = pd.DataFrame(X, columns=names)
    if category:
        table["P"] = np.array(["u", "v", "w"])[np.arange(n) % 3]
    if blocks:
        table["Block"] = np.array(["d1", "d2"])[np.arange(n) % 2]
    table = pd.concat([table, table.iloc[:6]], ignore_index=True)
    table["y"] = np.round(60 + 5 * table["E"] - 4 * table["F"] ** 2 + rng.normal(size=len(table)), 4)
    new = pd.DataFrame(np.round(rng.uniform(-1, 1, (3, len(names))), 3), columns=names)
    if category:
        new["P"] = ["u", "v", "w"]
    model = formula(names, category, blocks)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = pi.analyze_experiment(
            table, response_column="y", model=model, analysis_type=ASKED, coding=None, new_points=new
        )
    kept = {key: found[key] for key in ("model_summary", "coefficients", "lack_of_fit", "predictions")}
    return {
        "model": model,
        "runs": table.to_dict("list"),
        "new": new.to_dict("list"),
        "found": json.loads(json.dumps(kept, default=float)),
    }


if __name__ == "__main__":
    content = {"process-improve": version("process-improve"), "problems": [problem(seed) for seed in range(12)]}
    place = Path(__file__).with_name("process_improve.json")
    place.write_text(json.dumps(content, separators=(",", ":")) + "\n", encoding="utf-8")
