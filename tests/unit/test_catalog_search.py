"""Look-up by words, summaries, rows and JSON."""

import json
import random

import pytest

from seqrsm.catalog.rendering import summary, to_json
from seqrsm.catalog.search import entries_about, search, stem, words_of
from seqrsm.catalog.tables import Entry, Platform, load_catalog
from seqrsm.cli.show_catalog import show_asked_for

CATALOG = load_catalog()


@pytest.mark.parametrize(
    "family",
    [
        "map maps mapped mapping",
        "monitor monitors monitoring",
        "classify classified classification classifications",
        "identify identifies identification",
        "irrigate irrigated irrigation",
        "crop crops",
        "boundary boundaries",
        "wave waves",
        "explore exploration explorations",
    ],
)
def test_forms_of_a_word_have_one_stem(family: str) -> None:
    assert len({stem(word) for word in family.split()}) == 1


def test_stem_keeps_short_words_and_different_words_apart() -> None:
    assert [stem(w) for w in ("ice", "sea", "oil", "stress", "ICE")] == ["ice", "sea", "oil", "stress", "ice"]
    assert stem("classification") != stem("class")
    assert stem("soil") != stem("oil")


def found(words: str, **kwargs: str) -> set[tuple[str, str]]:
    return {(e.table, e.name) for e in search(words, **kwargs)}


def test_soil_moisture_finds_what_a_reader_finds() -> None:
    # read by eye from the tables: every line that holds soil and moisture, with the rows under such a heading
    places = [(e.table, e.number) for e in search("soil moisture")]
    assert sorted(places, key=lambda p: (int(p[0][2:]), p[1])) == [
        ("A.1", 6), ("A.1", 17), ("A.4", 29), ("A.5", 8), ("A.9", 11), ("A.9", 15), ("A.9", 17), ("A.10", 11),
        ("A.10", 15), ("A.13", 4), ("A.13", 6), ("A.14", 1), ("A.16", 1), ("A.16", 2), ("A.16", 3), ("A.16", 4),
        ("A.17", 1), ("A.17", 2),
    ]  # fmt: skip
    assert places[0][0] == "A.16"


def test_order_case_and_endings_do_not_matter() -> None:
    assert search("soil moisture") == search("MOISTURE, soils")
    assert search("crop classification") == search("classify crops")


def test_every_word_has_to_be_found() -> None:
    assert search("soil moisture salinity") == ()
    assert found("sea ice") < found("ice")
    assert all("Iceberg" not in name for _, name in found("sea ice"))
    assert ("A.3", "Snowfield Mapping (Moisture and Liquid Water Content)") in found("snow")


def test_synonyms() -> None:
    assert found("maize") == found("corn") == {("A.16", "Crop Classification (Bush and Ulaby): Corn")}
    assert ("A.12", "Crop Identification") in found("crop classification")


def test_application_before_category() -> None:
    names = [words_of(e.name) for e in search("water pollution")]
    in_name = ["water" in name for name in names]
    assert in_name == sorted(in_name, reverse=True)
    assert ("A.4", "Water Pollution/Quality") in found("water pollution")
    # Surface Mapping stands under Mineral Resources and Geologic Applications: found, but not about geologic mapping
    assert ("A.3", "Surface Mapping") in found("geologic mapping")
    assert {e.name for e in entries_about("geologic mapping")} == {
        "Geologic Mapping", "Regional Geologic Mapping", "Detailed Geologic Mapping",
    }  # fmt: skip
    assert entries_about("oceanography wave") == search("oceanography wave") != ()


def test_every_entry_is_found_by_its_own_name_and_none_never() -> None:
    everything = [e for e in CATALOG.entries if not e.is_none]
    assert set(search("")) == set(everything)
    for entry in random.Random(1).sample(everything, 40):
        assert entry in search(entry.name)
        assert entry in search(f"{entry.category} {entry.application}".upper(), system=entry.system)
    assert not any(e.is_none for e in search("none"))


def test_system() -> None:
    both = search("soil moisture")
    parts = search("soil moisture", system="active") + search("soil moisture", system="passive")
    assert set(parts) == set(both)
    assert len(search("soil moisture", system="passive")) == 3


def test_summary_groups_equal_prints() -> None:
    statements = {(s.parameter, s.system, s.printed): s for s in summary(search("soil moisture"))}
    angle = statements["nadir angle", "active", "7-17 [deg]"]
    assert angle.tables == ("A.16", "A.17")
    assert len(angle.applications) == 5
    assert statements["band", "passive", "S (1.5-5.0 GHz, 20-6.0 cm)"].tables == ("A.13", "A.14")
    assert statements["resolution class", "active", "less than 10m"].tables == ("A.1",)
    assert statements["resolution wanted and accepted", "active", "30 m, 90 m"].tables == ("A.17",)
    assert statements["wavelength or frequency", "active", "2-30 multifreq. [cm]"].read_as == "0.9993 to 14.99 GHz"
    assert statements["revisit", "active", "1-7 days"].tables == ("A.17",)
    assert summary(()) == ()


def entry(number: int) -> Entry:
    return next(e for e in CATALOG.entries if (e.table, e.number) == ("A.16", number))


@pytest.mark.parametrize("result", [search("soil moisture"), CATALOG.platforms], ids=["entries", "platforms"])
def test_json(result: tuple[Entry, ...] | tuple[Platform, ...]) -> None:
    document = to_json(result)
    assert json.loads(json.dumps(document, allow_nan=False)) == document


def test_entries_tell_what_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    show_asked_for([entry(25)], "wheat")
    shown = capsys.readouterr().out
    assert "A.16 Vegetation Resources: Crop Classification (Bush and Ulaby): Wheat" in shown
    assert "frequency [GHz] 14.2; 9; wanted [m] 25; accepted [m] 50;" in shown
    assert "nadir angle [deg] 40°-50° (best=50°)" in shown
    assert "read as" in shown
    document = to_json([entry(25)])[0]
    assert document["nadir_angle_deg"] == [{"low": 40.0, "high": 50.0}]
    assert document["name"] == "Crop Classification (Bush and Ulaby): Wheat"
