"""The command line starts without the heavy libraries, and each library stays where DESIGN puts it."""

import ast
import graphlib
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "seqrsm"
HEAVY = ("numpy", "scipy", "pandas", "numba", "matplotlib", "emcee", "sqlalchemy", "pydantic", "jinja2")

# third-party package -> files that may import it, relative to the package
HOMES = {
    "matplotlib": ("report/",),
    "jinja2": ("report/",),
    "typst": ("report/",),
    "typer": ("cli/",),
    "rich": ("cli/",),
    "sqlalchemy": ("store/",),
    "pydantic": ("spec/",),
    "emcee": ("fit/ensemble",),
    "numba": ("jit.py", "simulate/radar/kernels", "simulate/radiometer/kernels", "simulate/kernels"),
    "pandas": ("score/table.py", "cli/notebook.py", "cli/results.py"),
    "distributed": ("simulate/runner.py",),
    "tifffile": ("scene/", "campaign/", "simulate/", "cli/"),
}


def loaded_by(code: str) -> set[str]:
    script = f"import sys\n{code}\nprint()\nprint(','.join(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(done.stdout.strip().splitlines()[-1].split(","))


def test_help_loads_no_heavy_library() -> None:
    code = """
from seqrsm.cli.app import main
sys.argv = ["seqrsm", "--help"]
try:
    main()
except SystemExit:
    pass
"""
    assert not loaded_by(code) & set(HEAVY)


def test_fit_and_status_load_no_engine() -> None:
    """numba and the engines, and what draws and typesets, take time that only runs, proposals and reports need."""
    found = loaded_by("import seqrsm.campaign.campaign, seqrsm.analysis.to_json, seqrsm.cli.show_fit")
    assert "sqlalchemy" in found
    assert not found & {"numba", "matplotlib", "jinja2", "typst", "scipy.optimize", "scipy.fft"}


def test_engines_load_numba_with_the_first_kernel_that_is_called() -> None:
    code = "import numpy as np, seqrsm.campaign.dossier, seqrsm.campaign.loop, seqrsm.simulate.radar.psm"
    assert not loaded_by(code) & {"numba", "scipy.ndimage", "scipy.sparse", "scipy.interpolate"}
    call = "seqrsm.simulate.radar.kernels_speckle.relate(np.ones(9), np.uint64(0))"
    assert "numba" in loaded_by(f"{code}\n{call}")


def test_sampling_loads_no_part_of_scipy_that_it_does_not_use() -> None:
    assert "scipy.stats" not in loaded_by("import seqrsm.fit.ensemble, seqrsm.campaign.loop, seqrsm.cli.show_fit")
    assert "scipy.stats" in loaded_by("import seqrsm.fit.ensemble, scipy.stats; scipy.stats.norm.cdf(0.0)")
    for order in ("emcee, numpy, seqrsm.fit.ensemble", "seqrsm.fit.ensemble, emcee, numpy"):
        theirs = f"import {order}; x = numpy.random.default_rng(1).random((9, 2))"
        theirs += "; emcee.moves.KDEMove().get_proposal(x, [x], numpy.random.RandomState(1))"
        assert "scipy.stats" in loaded_by(theirs)


def test_another_thread_may_load_scipy_stats_while_the_sampler_loads() -> None:
    found = loaded_by("""
import sys
class While:
    def find_spec(self, name, *_):
        if name == "emcee.moves.red_blue":
            import scipy.stats  # as another thread may at any moment
sys.meta_path.insert(0, While())
import seqrsm.fit.ensemble
""")
    assert "scipy.stats" in found


def test_blas_of_the_command_line_keeps_to_one_thread_unless_told() -> None:
    code = """
import os
os.environ.pop("OPENBLAS_NUM_THREADS", None)
os.environ["MKL_NUM_THREADS"] = "3"
from seqrsm.cli.app import main
sys.argv = ["seqrsm", "--version"]
try:
    main()
except SystemExit:
    pass
assert (os.environ["OPENBLAS_NUM_THREADS"], os.environ["MKL_NUM_THREADS"]) == ("1", "3")
"""
    assert "numpy" not in loaded_by(code)


def test_the_probe_would_see_a_heavy_library() -> None:
    assert "numpy" in loaded_by("import seqrsm.design.factors")


@cache
def imports_in(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """At its top, inside functions, and for types only."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]


@pytest.mark.parametrize("library", HOMES)
def test_library_stays_at_home(library: str) -> None:
    strays = []
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        if name.startswith(HOMES[library]):
            continue
        for node in imports_in(path):
            modules = [a.name for a in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            strays += [f"{name}:{node.lineno}" for m in modules if m.split(".")[0] == library]
    assert not strays


def imports_of(path: Path, modules: set[str]) -> set[str]:
    """Modules of the package that a file imports."""
    found = set()
    for node in imports_in(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inner & modules or {node.module}
    return found & modules


def import_graph(root: Path) -> dict[str, set[str]]:
    paths = {
        path.relative_to(root.parent).with_suffix("").as_posix().replace("/", "."): path for path in root.rglob("*.py")
    }
    paths = {name.removesuffix(".__init__"): path for name, path in paths.items()}
    return {name: imports_of(path, set(paths)) - {name} for name, path in paths.items()}


def test_no_file_imports_its_way_round_a_circle() -> None:
    """Late imports and those for types count: they hide a circle, they do not open it."""
    graph = import_graph(PACKAGE)
    assert len(graph) > 200
    graphlib.TopologicalSorter(graph).prepare()


def test_a_circle_hidden_in_a_function_would_be_seen(tmp_path: Path) -> None:
    package = tmp_path / "p"
    package.mkdir()
    (package / "a.py").write_text("from p import b\n", encoding="utf-8")
    (package / "b.py").write_text("def f():\n    from p.a import g\n", encoding="utf-8")
    with pytest.raises(graphlib.CycleError):
        graphlib.TopologicalSorter(import_graph(package)).prepare()
