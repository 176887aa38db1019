"""campaign.toml: every fault with its line, its place in words, and what would be right."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from seqrsm.design.constraints import arithmetic
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.errors import SpecError
from seqrsm.spec.read import SPEC_NAME, CampaignSpec, load_spec

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
GOOD = """\
[campaign]
name = "crop-radar"
description = "..."
seed = 1979

[[factor]]
name = "frequency"
unit = "GHz"
low = 1.2
high = 17.0
scale = "log"
[[factor]]
name = "looks"
values = [1, 2, 4, 8, 16]
scale = "log"
[[factor]]
name = "polarization"
levels = ["HH", "VV", "HH+HV"]
[[factor]]
name = "resolution"
low = 10
high = 100

[[constraint]]
expr = "looks <= 4 * (resolution / 12.1) ** 2"

[[application]]
name = "crop-classification"
utility = "percent_correct"
goal = "maximize"
weight = 1.0
[application.prior]
utility = [40.0, 90.0]
repeat_sd = 2.0

[model]
order = 2
response = "logit"
errors = "normal"
block = "block"

[simulator]
engine = "psm"
scene = "scene.npz"
tolerance = 0.5
[simulator.fixed]
altitude_m = 3000.0
aperture = "synthetic"

[cost]
simulation = 1.0
flight = 250.0
[stop]
interval = "prediction"
half_width = 4.0
level = 0.95
max_runs = 80
[store]
url = "postgresql+psycopg://host/name"
"""


@pytest.fixture
def load(tmp_path):
    def loader(text: str | bytes, scene: bool = True) -> CampaignSpec:
        (tmp_path / SPEC_NAME).write_bytes(text if isinstance(text, bytes) else text.encode())
        if scene:
            (tmp_path / "scene.npz").write_bytes(b"")
        return load_spec(tmp_path)

    return loader


def edit(old: str, new: str) -> str:
    assert GOOD.count(old) == 1, old
    return GOOD.replace(old, new)


def problems(load, text, **options):
    with pytest.raises(SpecError) as caught:
        load(text, **options)
    return caught.value.problems


def test_the_contract_is_read(load, tmp_path):
    spec = load(GOOD)
    assert (spec.name, spec.seed, spec.batch, spec.folder) == ("crop-radar", 1979, 4, tmp_path)
    assert spec.factors == (
        ContinuousFactor("frequency", 1.2, 17.0, "GHz", "log"),
        DiscreteFactor("looks", (1.0, 2.0, 4.0, 8.0, 16.0), "", "log"),
        CategoricalFactor("polarization", ("HH", "VV", "HH+HV")),
        ContinuousFactor("resolution", 10.0, 100.0, "m"),
    )
    assert spec.region.constraints[0].expr == "looks <= 4 * (resolution / 12.1) ** 2"
    assert spec.region.names == ("frequency", "looks", "polarization", "resolution")
    (application,) = spec.applications
    assert (application.utility, application.goal, application.weight) == ("percent_correct", "maximize", 1.0)
    assert application.is_percent
    assert application.score_unit == "percent"
    assert (spec.model.order, spec.model.response, spec.model.block) == (2, "logit", "block")
    assert (application.prior.utility, application.prior.repeat_runs) == ([40.0, 90.0], 3)
    assert (spec.simulator.engine, spec.simulator.tolerance) == ("psm", 0.5)
    assert spec.simulator.fixed == {"altitude_m": 3000.0, "aperture": "synthetic"}
    assert spec.scene_path == tmp_path / "scene.npz"
    assert (spec.cost.simulation, spec.cost.flight) == (1.0, 250.0)
    assert (spec.stop.half_width, spec.stop.interval, spec.stop.level, spec.stop.max_runs) == (
        4,
        "prediction",
        0.95,
        80,
    )
    assert (spec.stop.guard, spec.stop.replicates, spec.stop.confirmation_runs) == ("runs", 5, 5)
    assert spec.store_url == "postgresql+psycopg://host/name"
    assert spec.application("crop-classification") is application


def test_the_least_file_has_the_defaults(load):
    spec = load(
        '[campaign]\nname = "a"\n[[factor]]\nname = "x"\nlow = 0\nhigh = 1\n'
        '[[application]]\nname = "b"\nutility = "my.module:function"\n[stop]\nhalf_width = 1\n'
    )
    assert spec.simulator is None
    assert spec.scene_path is None
    assert spec.store_url is None
    assert spec.applications[0].prior is None
    assert (spec.model.order, spec.model.response, spec.model.errors, spec.model.block) == (
        2,
        "identity",
        "normal",
        None,
    )
    assert (spec.stop.interval, spec.stop.level, spec.stop.max_runs) == ("prediction", 0.95, 80)
    assert (spec.cost.simulation, spec.cost.flight, spec.seed) == (1.0, 1.0, 0)
    assert spec.applications[0].score_unit == ""


def test_the_specification_cannot_be_changed(load):
    spec = load(GOOD)
    with pytest.raises(dataclasses.FrozenInstanceError):
        spec.name = "other"  # type: ignore[misc]
    with pytest.raises(ValueError, match="frozen"):
        spec.stop.level = 0.5


def test_mark_and_line_ends_of_other_editors(load):
    spec = load(GOOD)
    assert load("\ufeff" + GOOD).spec_hash == spec.spec_hash
    assert load(GOOD.replace("\n", "\r\n")).spec_hash == spec.spec_hash


def test_the_hash_is_that_of_earlier_versions():
    """Else campaigns that go on with a new version are told that their file has changed."""
    assert load_spec(CAMPAIGNS / "flevoland").spec_hash[:12] == "eb794c187dfb"


def test_a_default_that_is_written_leaves_the_hash_alone(load):
    before = load(GOOD).spec_hash
    assert load(GOOD.replace("[stop]\n", '[stop]\nworlds = "count"\n')).spec_hash == before
    assert load(GOOD.replace("[stop]\n", '[stop]\nworlds = "ignore"\n')).spec_hash != before


def test_hash_is_of_the_content(load):
    spec = load(GOOD)
    assert load("# comment\n" + GOOD.replace("low = 1.2", "low   = 1.20")).spec_hash == spec.spec_hash
    assert load(GOOD.replace('scale = "log"\n[[factor]]\nname = "looks"', '[[factor]]\nname = "looks"')).spec_hash != (
        spec.spec_hash
    )
    assert load(edit('url = "postgresql+psycopg://host/name"', "")).spec_hash == spec.spec_hash
    for old, new in [("seed = 1979", "seed = 1980"), ("altitude_m = 3000.0", "altitude_m = 3001.0")]:
        assert load(edit(old, new)).spec_hash != spec.spec_hash


FAULTS = [
    # old, new, text of the offending line, field, part of message or remedy
    ("seed = 1979", "sead = 1979", "sead = 1979", "[campaign] sead", "Did you mean 'seed'"),
    ("seed = 1979", "seed = -1", "seed = -1", "[campaign] seed", "greater than or equal to 0"),
    ("seed = 1979", "seed = 1.5", "seed = 1.5", "[campaign] seed", "whole number"),
    ("seed = 1979", "seed = true", "seed = true", "[campaign] seed", "whole number"),
    ("seed = 1979", "batch = 0", "batch = 0", "[campaign] batch", "greater than or equal to 1"),
    ('name = "crop-radar"\n', "", "[campaign]", "[campaign] name", "missing"),
    ('"crop-radar"', '"a/b"', 'name = "a/b"', "[campaign] name", "letters, digits"),
    ('"crop-radar"', "3", "name = 3", "[campaign] name", "quotes"),
    ('unit = "GHz"', 'unit = "MHz"', 'unit = "MHz"', "factor 'frequency': unit", 'unit = "GHz"'),
    ("low = 1.2", "low = 18.0", "low = 18.0", "factor 'frequency': low", "below"),
    ("low = 1.2", "low = 17.0", "low = 17.0", "factor 'frequency': low", "below"),
    ("low = 1.2", "low = 0.0", "low = 0.0", "factor 'frequency': low", "positive"),
    ("low = 1.2", "low = nan", "low = nan", "factor 'frequency': low", "finite"),
    ("low = 1.2", 'low = "1.2"', 'low = "1.2"', "factor 'frequency': low", "without quotes"),
    ("low = 1.2\n", "", "[[factor]]", "factor 'frequency'", "low and high"),
    ("low = 1.2\n", "low = 1.2\nvalues = [1]\n", "[[factor]]", "factor 'frequency'", "low and high"),
    ("low = 1.2", "colour = 1.2\nlow = 1.2", "colour = 1.2", "factor 'frequency': colour", "not a known key"),
    ('name = "frequency"', 'name = "freqency"', 'name = "freqency"', "factor 'freqency': name", "'frequency'"),
    ('name = "frequency"', 'name = "score"', 'name = "score"', "factor 'score': name", "scores file"),
    ('name = "resolution"', 'name = "looks"', 'name = "looks"', "factor 'looks': name", "two tables"),
    ("[1, 2, 4, 8, 16]", "[1, 2, 2]", "values = [1, 2, 2]", "factor 'looks': values", "twice"),
    ("[1, 2, 4, 8, 16]", "[4]", "values = [4]", "factor 'looks': values", "at least two"),
    ("[1, 2, 4, 8, 16]", "4", "values = 4", "factor 'looks': values", "square brackets"),
    ("[1, 2, 4, 8, 16]", '[1,\n "2"]', ' "2"]', "factor 'looks': values no. 2", "without quotes"),
    ("[1, 2, 4, 8, 16]", "[0, 1]", "values = [0, 1]", "factor 'looks': values", "positive"),
    (
        '["HH", "VV", "HH+HV"]',
        '["HH", "HX"]',
        'levels = ["HH", "HX"]',
        "factor 'polarization': levels no. 2",
        "HH, HV, VV",
    ),
    ('["HH", "VV", "HH+HV"]', '["HH", "HV+HV"]', 'levels = ["HH", "HV+HV"]', "levels no. 2", "HH, HV, VV"),
    ('["HH", "VV", "HH+HV"]', '["HV+HH", "HH+HV"]', 'levels = ["HV+HH", "HH+HV"]', "levels no. 2", "same set"),
    ('["HH", "VV", "HH+HV"]', '["HH", 2]', 'levels = ["HH", 2]', "levels no. 2", "values = [...] instead of levels"),
    ('["HH", "VV", "HH+HV"]', '["HH", "HH"]', 'levels = ["HH", "HH"]', "factor 'polarization': levels", "twice"),
    ('levels = ["HH", "VV", "HH+HV"]', "low = 0\nhigh = 1", "[[factor]]", "factor 'polarization'", "levels"),
    ("looks <= 4", "looks <=> 4", 'expr = "looks <=> 4', "constraint no. 1: expr", "not an expression"),
    ("looks <= 4", "lucks <= 4", 'expr = "lucks <= 4', "constraint no. 1: expr", "not a factor"),
    ("looks <= 4", "__import__('os') <= 4", "expr =", "constraint no. 1: expr", "Allowed are"),
    ("looks <= 4 * (resolution / 12.1) ** 2", "looks <= 0", "expr =", "constraint no. 1: expr", "no setting"),
    (
        '"percent_correct"',
        '"percent_corect"',
        "utility =",
        "application 'crop-classification': utility",
        "percent_correct",
    ),
    ('"maximize"', '"maximise"', "goal =", "application 'crop-classification': goal", 'Did you mean "maximize"'),
    ("weight = 1.0", "weight = 0", "weight = 0", "application 'crop-classification': weight", "greater than 0"),
    ("order = 2", "order = 3", "order = 3", "[model] order", "1 or 2"),
    ("order = 2", "order = true", "order = true", "[model] order", "1 or 2"),
    (
        "repeat_sd = 2.0",
        "repeat_sd = 0",
        "repeat_sd = 0",
        "application 'crop-classification': prior.repeat_sd",
        "greater than 0",
    ),
    (
        "utility = [40.0, 90.0]\n",
        "",
        "[application.prior]",
        "application 'crop-classification': prior",
        "Give utility = [low, high]",
    ),
    ('"scene.npz"', '"absent.npz"', 'scene = "absent.npz"', "[simulator] scene", "no such file"),
    ('engine = "psm"', 'engine = "pms"', 'engine = "pms"', "[simulator] engine", 'Did you mean "psm"'),
    ("altitude_m = 3000.0", "altitude_m = true", "altitude_m = true", "[simulator] fixed.altitude_m", "number"),
    ("altitude_m = 3000.0", "looks = 4", "looks = 4", "[simulator] fixed.looks", "both a factor and fixed"),
    ("tolerance = 0.5", "tolerance = inf", "tolerance = inf", "[simulator] tolerance", "finite"),
    ("flight = 250.0", "flight = -250.0", "flight = -250.0", "[cost] flight", "greater than or equal to 0"),
    ("half_width = 4.0", "half_width = 0", "half_width = 0", "[stop] half_width", "greater than 0"),
    ("half_width = 4.0\n", "", "[stop]", "[stop] half_width", "missing"),
    ("level = 0.95", "level = 95", "level = 95", "[stop] level", "equal to 0.9999. Write 0.95 for 95 %."),
    ("level = 0.95", "level = 0", "level = 0", "[stop] level", "greater than or equal to 0.5"),
    ("level = 0.95", "level = 1e-300", "level = 1e-300", "[stop] level", "greater than or equal to 0.5"),
    ("max_runs = 80", "max_runs = 0", "max_runs = 0", "[stop] max_runs", "equal to 1"),
    ("max_runs = 80", "max_run = 80", "max_run = 80", "[stop] max_run", "'max_runs'"),
    ('"prediction"', '"predicton"', "interval =", "[stop] interval", 'Did you mean "prediction"'),
    ("max_runs = 80", "confirmation_runs = 1", "confirmation_runs = 1", "[stop] confirmation_runs", "equal to 2"),
    ('"postgresql+psycopg://host/name"', '"mysql://x"', "url =", "[store] url", "postgresql+psycopg"),
    ("[cost]", "[costs]", "[costs]", "[costs]", "'cost'"),
]


@pytest.mark.parametrize(("old", "new", "line", "field", "says"), FAULTS)
def test_one_fault(load, old, new, line, field, says):
    text = edit(old, new)
    (problem,) = problems(load, text)
    assert line in text.splitlines()[problem.line - 1]
    assert problem.field.endswith(field)
    assert says in f"{problem.message}. {problem.remedy}"
    assert Path(problem.file).name == SPEC_NAME


def test_scores_of_different_units_share_no_target(load):
    """A target of 4 percent would be met by any error in m3/m3 whatever."""
    second = '[[application]]\nname = "b"\nutility = "measured"\nunit = "m3/m3"\ngoal = "minimize"\n[stop]'
    text = GOOD.replace("[stop]", second).replace('response = "logit"', 'response = "identity"')
    found = problems(load, text)
    assert [problem.remedy for problem in found] == [
        "Add half_width = NUMBER, in percent.",
        "Add half_width = NUMBER, in m3/m3.",
    ]
    assert all("share [stop] half_width" in problem.message for problem in found)
    spec = load(text.replace('unit = "m3/m3"', 'unit = "m3/m3"\nhalf_width = 0.02'))
    assert [spec.stop_of(one.name).half_width for one in spec.applications] == [4.0, 0.02]
    limited = text.replace('unit = "m3/m3"', 'unit = "m3/m3"\nhalf_width = 0.02').replace(
        "[stop]", "[stop]\nloss = 1.0"
    )
    assert {problem.remedy for problem in problems(load, limited)} == {
        "Add loss = NUMBER, in percent.",
        "Add loss = NUMBER, in m3/m3.",
    }
    spec = load(limited.replace("half_width = 0.02", "half_width = 0.02\nloss = 0.005").replace("loss = 1.0\n", ""))
    assert [spec.stop_of(one.name).loss for one in spec.applications] == [None, 0.005]


def test_all_faults_at_once_in_order(load):
    text = GOOD
    for old, new in [
        ("seed = 1979", "sead = 1979"),
        ('unit = "GHz"', 'unit = "MHz"'),
        ("high = 17.0", 'high = "17.0"'),
        ("looks <= 4", "looks <=> 4"),
        ('"maximize"', '"maximise"'),
        ('"scene.npz"', '"absent.npz"'),
        ("half_width = 4.0", "half_width = -4.0"),
        ("[cost]", "[costs]"),
    ]:
        text = text.replace(old, new)
    found = problems(load, text)
    assert len(found) == 8
    assert [p.line for p in found] == sorted(p.line for p in found)


def test_applications_need_different_names(load):
    second = '[[application]]\nname = "crop-classification"\nutility = "percent_correct"\n'
    (problem,) = problems(load, GOOD + second)
    assert problem.field == "application 'crop-classification': name"
    assert problem.line == GOOD.count("\n") + 2


@pytest.mark.parametrize("table", ["campaign", "factor", "application", "stop"])
def test_tables_that_must_be_there(load, table):
    chunks = re.split(r"(?m)^(?=\[)", GOOD)
    found = problems(load, "".join(chunk for chunk in chunks if not chunk.lstrip("[").startswith(table)))
    assert f"[{table}]" in {p.field for p in found}


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        (b"a = 1\nb = \xff\n", 2, "UTF-8"),
        ("a = 1\nb = 'x'\nb = 2\n", 3, "TOML"),
        ("a = 1\n\n[x\n", 3, "TOML"),
        ("a = ", 1, "TOML"),
        ("", 1, "no [campaign]"),
        ("campaign = 3", 1, "table"),
        ('factor = "x"', 1, "double brackets"),
        ("[factor]\nname = 'x'", 1, "double brackets"),
        ("factor = []", 1, "empty"),
        ("factor = [1]", 1, "table"),
    ],
)
def test_broken_files(load, text, line, says):
    found = problems(load, text)
    assert any(p.line == line and says in str(p) for p in found)


def test_missing_file(tmp_path):
    for place in (tmp_path, tmp_path / "absent", tmp_path / SPEC_NAME):
        with pytest.raises(SpecError, match="no such file") as caught:
            load_spec(place)
        assert "seqrsm init" in str(caught.value)


def test_without_a_simulator_names_and_levels_are_free(load):
    text = GOOD[: GOOD.index("[simulator]")] + "[stop]\nhalf_width = 1\n"
    spec = load(text.replace('"HH+HV"', '"FULLPOL"').replace('"frequency"\nunit = "GHz"', '"speed"\nunit = "m/s"'))
    assert spec.factors[2].levels == ("HH", "VV", "FULLPOL")


@pytest.mark.parametrize("path", sorted(CAMPAIGNS.glob("*/campaign.toml")), ids=lambda path: path.parent.name)
def test_example_campaigns_are_valid(path):
    assert load_spec(path).description


def test_an_application_names_its_words_of_the_catalogue(load):
    text = GOOD.replace('name = "crop-classification"', 'name = "x17"\ncatalog = "soil moisture"')
    assert load(text).applications[0].catalog == "soil moisture"
    with pytest.raises(SpecError) as caught:
        load(text.replace("soil moisture", "warp drive"))
    (problem,) = caught.value.problems
    assert "no radar entry of Tables A.1 to A.20" in problem.message
    assert (problem.value, problem.line) == ("warp drive", text.split("\n").index('catalog = "soil moisture"') + 1)
    with pytest.raises(SpecError):
        load(text.replace("soil moisture", "  "))


CANDIDATES = """
[[candidate]]
sensor = "Sentinel-1 IW"
polarization = "VH+VV"
[[candidate]]
sensor = "*"
[[candidate]]
name = "ours"
parameters = { frequency = 5.3, looks = 4 }
"""


def test_candidates_are_read_and_leave_the_hash_alone(load):
    spec = load(GOOD + CANDIDATES)
    assert [one.sensor for one in spec.candidates] == ["Sentinel-1 IW", "*", ""]
    assert spec.candidates[2].parameters == {"frequency": 5.3, "looks": 4}
    assert spec.spec_hash == load(GOOD).spec_hash


@pytest.mark.parametrize(
    ("old", "new", "line", "field", "says"),
    [
        ('"Sentinel-1 IW"', '"Sentinal-1"', "sensor =", "sensor", "Did you mean Sentinel-1"),
        ('"Sentinel-1 IW"', '"SMAP L"', "sensor =", "sensor", "simulates radars"),
        ('"VH+VV"', '"HH+VV"', "polarization =", "polarization", "VV+VH, or HH+HV"),
        ("frequency = 5.3, looks", "frequency = 5.3, lokks", "parameters =", "parameters.lokks", "'looks'"),
        ("looks = 4 }", "looks = 0 }", "parameters =", "parameters.looks", "out of range"),
        ('name = "ours"\n', "", "[[candidate]]", "candidate no. 3", "a name with parameters"),
        ('"*"', '"Sentinel-1 IW"\npolarization = "VH+VV"', "[[candidate]]", "candidate no. 2", "twice"),
        ("sensor =", "senser =", "senser =", "senser", "'sensor'"),
    ],
)
def test_faults_of_candidates(load, old, new, line, field, says):
    text = GOOD + CANDIDATES.replace(old, new, 1)
    problem = problems(load, text)[0]
    assert line in text.splitlines()[problem.line - 1]
    assert problem.field.endswith(field)
    assert says in f"{problem.message}. {problem.remedy}"


def test_a_measured_score_has_the_units_of_its_own_that_it_is_given(load):
    text = GOOD.replace('utility = "percent_correct"', 'utility = "measured"\nunit = "dB"')
    text = text.replace('response = "logit"', 'response = "identity"')
    assert load(text).applications[0].score_unit == "dB"


@pytest.mark.parametrize(
    "utility", ['"measured"\nunit = "m3/m3"', '"kappa"', '"correlation"', '"mine:score"\nunit = "dB"']
)
def test_logits_are_of_percentages(load, utility):
    """Of an error in m3/m3 the fit said that runs and prior left terms undetermined."""
    text = GOOD.replace('"percent_correct"', utility)
    with pytest.raises(SpecError, match=r"response: logits are of scores from 0 to 100 .*'crop-classification'"):
        load(text)
    load(text.replace('response = "logit"', 'response = "identity"'))
    for percent in ('"measured"', '"measured"\nunit = "%"', '"mine:score"'):
        load(GOOD.replace('"percent_correct"', percent))


def test_a_utility_that_has_a_unit_keeps_it(load):
    with pytest.raises(SpecError, match=r"application 'crop-classification': unit: scores .* in percent .*'dB'"):
        load(GOOD.replace('utility = "percent_correct"', 'utility = "percent_correct"\nunit = "dB"'))
    load(GOOD.replace('utility = "percent_correct"', 'utility = "percent_correct"\nunit = "percent"'))


def test_a_faulty_factor_is_the_only_fault(tmp_path: Path) -> None:
    """An expression of it is not said to have no such factor."""
    text = GOOD.replace("high = 100\n", "high = 1\n") + '[[consideration]]\nname = "cost"\nexpr = "1 / resolution"\n'
    (tmp_path / SPEC_NAME).write_text(text, encoding="utf-8")
    (tmp_path / "scene.npz").touch()
    with pytest.raises(SpecError) as found:
        load_spec(tmp_path)
    assert [one.field for one in found.value.problems] == ["factor 'resolution': low"]


@pytest.mark.parametrize(
    ("expr", "says"),
    [
        ("20 + 15 * (polarization == 'VV') + 100 / resolution", ""),
        ("15 * (polarization in ('VV', 'XX'))", "'polarization' has no such level"),
        ("15 * (resolution < 20)", "'Compare' is not allowed"),
        ("15 * polarization", "a categorical factor stands where a number is needed"),
        ("15 * band", "a name is not a factor"),
    ],
)
def test_a_consideration_may_depend_on_a_level(load, expr, says):
    text = GOOD + f'[[consideration]]\nname = "price"\nexpr = "{expr}"\n'
    if says:
        with pytest.raises(SpecError, match=says):
            load(text)
        return
    spec = load(text)
    settings = {"polarization": np.array(["HH", "VV"]), "resolution": np.array([10.0, 20.0])}
    np.testing.assert_array_equal(arithmetic(spec.considerations[0].expr).right(settings, 2), [30.0, 40.0])


PRICE = '[[consideration]]\nname = "price"\nexpr = "1 / (resolution - 10)"\n'


@pytest.mark.parametrize(
    ("expr", "says"),
    [
        ("log(resolution - 12)", "there is no finite value at resolution 10"),
        ("1 / (resolution - 100)", "there is no finite value at resolution 100"),
        ("1 / ((resolution - 10) * (polarization == 'VV'))", "no finite value at polarization HH, resolution 10"),
        ("2 * 1e400", "a number is too large (column 5)"),
        ("2 *", "this is not an expression"),
    ],
)
def test_a_consideration_has_a_value_everywhere(load, expr, says):
    """Where it had none, the search of a compromise did not end."""
    (problem,) = problems(load, GOOD + f'[[consideration]]\nname = "price"\nexpr = "{expr}"\n')
    assert says in problem.message
    assert problem.value == expr


def test_a_consideration_waits_for_a_region(load):
    """Of factors that leave none it ended in a traceback."""
    (problem,) = problems(load, GOOD + '[[constraint]]\nexpr = "resolution > 1e9"\n' + PRICE)
    assert problem.field != "expr"


def test_a_constraint_may_exclude_where_a_consideration_has_no_value(load):
    load(GOOD + PRICE + '[[constraint]]\nexpr = "resolution >= 11"\n')


@pytest.mark.parametrize("score", [150.0, -0.1])
def test_what_suffices_is_a_score_that_there_can_be(load, score):
    text = GOOD.replace('utility = "percent_correct"', f'utility = "percent_correct"\nsufficient = {score}')
    (problem,) = problems(load, text)
    assert text.splitlines()[problem.line - 1] == f"sufficient = {score}"
    assert (problem.message, problem.value) == ("there is no such score", score)
    assert problem.remedy == "Scores go from 0 to 100."
    assert load(text.replace(f"sufficient = {score}", "sufficient = 100")).applications[0].sufficient == 100.0
