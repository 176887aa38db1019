"""Texture within fields: its size, its scale, its independence of everything else, and the rungs of the ladder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from psm_cases import Table, radar, scene

from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.simulate.radar.frame import make_frame, pieces
from seqrsm.simulate.radar.kernels import sum_echoes
from seqrsm.simulate.radar.psm import simulate_radar


def site():
    rng = np.random.default_rng(0)
    field = np.kron(np.arange(6).reshape(2, 3), np.ones((60, 60), dtype=int))
    cover = np.kron(rng.integers(0, 2, (2, 3)), np.ones((60, 60), dtype=int))
    return scene(np.zeros(field.shape), 5.0, cover, field)


def image(run_id=1, **changes):
    given = {"fading": "none", "resolution_m": 10.0, "peak_power_w": 1e6, **changes}
    return simulate_radar(site(), radar(**given), Table((-8.0, -12.0), field_sd_db=1.0), seed=1, run_id=run_id)


def test_pieces_stay_within_fields():
    cut, parent = pieces(site(), 50.0)
    assert (parent[cut.field_id] == site().field_id).all()
    assert 6 * 20 < len(parent) < 6 * 70
    assert make_frame(site(), radar(texture_db=1.0), "float32").field.max() == len(parent) - 1


def test_parts_of_a_field_scatter_by_as_much_as_asked_for():
    plain = image()
    piece = pieces(site(), 100.0)[0].field_id.ravel()
    spread = []
    for run in range(1, 13):
        one, even = image(run, texture_db=1.5, texture_m=100.0), image(run)
        ratio = 10.0 * np.log10(one.mean_power[0] / even.mean_power[0])
        spread.append(np.bincount(piece, ratio.ravel()[one.pixel_of_cell.ravel()]) / np.bincount(piece))
    # Pixels at the border of two pieces are mixtures, so the means of pieces scatter a little less.
    assert np.std(np.concatenate(spread)) == pytest.approx(1.42, abs=0.12)
    assert abs(np.mean(spread)) < 0.15
    assert plain.occasion.field_offset_db.shape == (1, 6)


def test_no_texture_leaves_every_bit_as_it_was_and_fields_keep_their_draws():
    np.testing.assert_array_equal(image().intensity, image(texture_db=0.0, texture_m=20.0).intensity)
    one = image(texture_db=1.0)
    mean = np.bincount(pieces(site(), 50.0)[1], one.occasion.field_offset_db[0]) / np.bincount(pieces(site(), 50.0)[1])
    np.testing.assert_allclose(mean, image().occasion.field_offset_db[0], atol=0.75)
    assert any("parts of fields" in note for note in one.notes)


def test_channels_share_part_of_it():
    table = Table((-8.0, -12.0), channel_correlation=0.6)
    r = radar(channels=("HH", "VV"), texture_db=1.0, texture_m=5.0)
    offset = simulate_radar(site(), r, table, seed=1, run_id=1).occasion.field_offset_db
    assert np.corrcoef(offset)[0, 1] == pytest.approx(0.6, abs=0.02)
    alone = simulate_radar(site(), radar(channels=("VV",), texture_db=1.0, texture_m=5.0), table, seed=1, run_id=1)
    np.testing.assert_array_equal(alone.occasion.field_offset_db[0], offset[1])


def test_the_kernel_is_compiled_once_whatever_a_radar_records():
    """Arrays in another order would be another type, and to compile for it takes seconds."""
    table = load_sigma0_table()
    for channels in (("HH", "HV"), ("HH", "HV", "VV", "phase")):
        for texture_db in (0.0, 1.0):
            given = radar(channels=channels, texture_db=texture_db)
            simulate_radar(replace(site(), categories=("Wheat", "Corn")), given, table, seed=1, run_id=1)
    layouts = [getattr(one, "layout", "C") for types in sum_echoes.compiled.signatures for one in types]
    assert set(layouts) == {"C"}
