"""Fading: the generator against published vectors, its law against the gamma law, pixels against each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from seqrsm.rng import generator, stream_key
from seqrsm.simulate.radar import kernels_speckle as kernels
from seqrsm.simulate.radar.fading import gamma_tables, normal_table

# Known answers of the Random123 library, file kat_vectors, philox4x32 with 10 rounds (Salmon et al. 2011).
VECTORS = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.mark.parametrize(("counter", "key", "expected"), VECTORS)
def test_philox_gives_the_published_words(counter, key, expected):
    words = kernels.philox4x32(*(np.uint32(x) for x in (*counter, *key)))
    assert tuple(int(w) for w in words) == expected


def speckled(looks, shape=(1, 400, 500), key=(1, 2), noise=0.0, mean=1.0):
    n_range = shape[1]
    out = np.empty(shape)
    looks = np.broadcast_to(np.asarray(looks, dtype=float), (n_range,)).copy()
    words = (np.uint32(key[0]), np.uint32(key[1]))
    given = np.arange(shape[0]), normal_table(), *words, 0, out, *kernels.work_lines(shape[2])
    kernels.add_speckle(np.full(shape, mean), np.full(n_range, noise), *gamma_tables(looks), looks**-0.5, *given)
    return out


@pytest.mark.parametrize("looks", [1.0, 1.7, 4.0, 40.5, 1e4, 1e6])
def test_fading_is_gamma_with_any_real_number_of_looks(looks):
    x = speckled(looks).ravel()
    n = x.size
    assert x.min() > 0.0
    assert x.mean() == pytest.approx(1.0, abs=4.0 / np.sqrt(n * looks))
    # Variance of a sample variance: (kurtosis + 2) var**2 / n with excess kurtosis 6/N.
    assert x.var() * looks == pytest.approx(1.0, abs=4.0 * np.sqrt((2.0 + 6.0 / looks) / n))
    distance, p = stats.kstest(x, stats.gamma(looks, scale=1.0 / looks).cdf)
    assert p > 1e-3, distance


@pytest.mark.parametrize("looks", [1.0, 1.001, 1.7, 3.0, 4.0, 16.0, 40.5, 333.3, 1e4, 1e6])
def test_fading_has_the_probability_of_its_normal_variate(looks):
    z = np.concatenate([np.linspace(-6.3, 6.3, 4001), np.linspace(-0.01, 0.01, 101)])
    got = np.empty((1, z.size))
    kernels.fade(z[None], *gamma_tables(np.array([looks])), np.array([looks**-0.5]), got)
    # Each tail from its own side, in units of the tail itself.
    for side, law, normal in ((z <= 0.0, stats.gamma.cdf, stats.norm.cdf), (z > 0.0, stats.gamma.sf, stats.norm.sf)):
        expected = normal(z[side])
        error = np.abs(law(got[0, side], looks, scale=1.0 / looks) / expected - 1.0)
        assert (error * expected).max() < 1e-6
        assert error[expected > 1e-4].max() < 2e-5
        assert error.max() < 2e-3


def test_normal_variates_are_the_quantiles_of_their_words():
    # Words of one counter, and the quantile of the probability each stands for.
    out = np.empty((40, 50))
    key = (np.uint32(5), np.uint32(6))
    kernels.fill_normal(3, normal_table(), *key, out)
    for row in (0, 7, 39):
        for column in range(50):
            zero = np.uint32(0)
            word = kernels.philox4x32(np.uint32(row), np.uint32(column // 4), np.uint32(3), zero, *key)[column % 4]
            beyond = (int(word) % 2**31 + 0.5) / 2.0**32
            expected = stats.norm.isf(beyond) if int(word) < 2**31 else stats.norm.ppf(beyond)
            assert out[row, column] == pytest.approx(expected, abs=1e-5)


def test_neighbours_channels_and_keys_are_independent():
    x = speckled(4.0, (2, 300, 400)) - 1.0
    other = speckled(4.0, (2, 300, 400), key=(1, 3)) - 1.0
    limit = 4.5 * 0.25 / np.sqrt(x[0].size)
    for a, b in (
        (x[0, 1:], x[0, :-1]),
        (x[0, :, 1:], x[0, :, :-1]),
        (x[0, 1:, 1:], x[0, :-1, :-1]),
        (x[0], x[1]),
        (x[0], other[0]),
    ):
        assert abs(np.mean(a * b)) < limit * 1.1
        assert abs(np.mean(a**2 * b**2) - np.mean(a**2) * np.mean(b**2)) < 30.0 * limit * 0.25


def test_a_pixel_does_not_depend_on_the_size_of_the_image():
    large = speckled(2.5, (2, 60, 70))
    small = speckled(2.5, (1, 20, 30))
    np.testing.assert_array_equal(large[:1, :20, :30], small)


def test_looks_and_noise_go_by_row():
    looks = np.repeat([1.0, 100.0], 200)
    x = speckled(looks, (1, 400, 500), noise=3.0)
    assert x.mean() == pytest.approx(4.0, rel=0.01)
    assert (x[0, :200] / 4).var() == pytest.approx(1.0, rel=0.03)
    assert (x[0, 200:] / 4).var() == pytest.approx(0.01, rel=0.03)


def test_keys_tell_runs_and_purposes_apart():
    keys = {
        tuple(int(w) for w in stream_key(seed, run, purpose))
        for seed in (-1, 0, 1, 11)
        for run in (0, 1, 11, 2**40)
        for purpose in ("speckle", "field", "1")
    }
    assert len(keys) == 48
    a = generator(1, 2, "x").standard_normal(5)
    np.testing.assert_array_equal(a, generator(1, 2, "x").standard_normal(5))
    assert not np.array_equal(a, generator(1, 3, "x").standard_normal(5))


def test_keys_are_the_same_on_every_platform():
    # printf 'seqrsm|1979|3|speckle' | b2sum -l 64  ->  165e577e1c1bceeb, taken as two little-endian words.
    assert [int(w) for w in stream_key(1979, 3, "speckle")] == [0x7E575E16, 0xEBCE1B1C]
