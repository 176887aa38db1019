"""Receiver, quantiser and film of the report: from received power to intensity, density and grey tone.

M and S of RSL TR 380-1 eqs. (3-1) to (3-3) are functions of power arrays. None stands for a linear one that changes
nothing, and costs nothing. Q comes before pulses are compressed and looks averaged: there the echo is the sum of many
waves, whose real and imaginary parts are Gaussian, and what is rounded off is noise that spreads over the image.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import ndtr

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.errors import ConfigurationError
from seqrsm.own_code import contained, import_remedy, own_function
from seqrsm.sensor.radar import PHASE, RadarConfiguration
from seqrsm.simulate.radar.result import RadarImage

Transfer = Callable[[FloatArray], FloatArray]
"""Transfer function of one stage: power or intensity in, intensity out, both >= 0."""


def received(power_w: AnyArray, radar: RadarConfiguration, reference_w: float) -> AnyArray:
    """Intensity of an image after the radar's own receiver M and processing S: eqs. (3-1) and (3-3).

    ``power_w`` (n_channels, n_range, n_azimuth) is the received power with fading [W], ``reference_w`` that of flat
    ground of sigma0 = 1 at the centre of the swath [W]. The intensity is of the same type, on the scale of the input,
    which a linear receiver returns itself.

    Raises
    ------
    ConfigurationError
        A receiver or processing named as ``package.module:function`` cannot be imported or fails.
    """
    level = reference_w * 10.0 ** (0.1 * radar.receiver_level_db)
    stage = transfer_function(radar, level)
    processing = named_function("processing", radar.processing) if radar.processing else None
    if stage is None and processing is None:
        return power_w
    out: AnyArray = np.asarray(power_w, dtype=np.float64)
    if stage is not None:
        out = stage(out)
    if processing is not None:
        out = processing(out)
    return np.asarray(out, dtype=power_w.dtype)


def converter_error(bits: int, full_scale_db: float) -> float:
    """Noise over signal that a converter leaves of a Gaussian echo, linear.

    I and Q are each held within the full scale and rounded to 2**bits equal steps; ``full_scale_db`` is the power of
    one that is at it, over that of the echo, both together [dB]. What comes out is the echo times a gain, which
    calibration takes out, and noise that has nothing to do with it (Bussgang 1952, MIT RLE Technical Report 216).
    """
    half = 2 ** (min(bits, 16) - 1)  # finer steps than those of 16 bits are none
    step = math.sqrt(2.0) * 10.0 ** (0.05 * full_scale_db) / half
    edge, shown = step * np.arange(half), step * (np.arange(half) + 0.5)  # of positive numbers, of variance 1
    above = np.append(ndtr(-edge), 0.0)
    density = np.append(np.exp(-0.5 * edge**2) / math.sqrt(2.0 * math.pi), 0.0)
    power = 2.0 * float(np.square(shown) @ (above[:-1] - above[1:]))
    gain = 2.0 * float(shown @ (density[:-1] - density[1:]))
    return power / gain**2 - 1.0


def converter_noise(
    mean: AnyArray, noise_w: FloatArray, calibration_w: FloatArray, radar: RadarConfiguration
) -> FloatArray:
    """Noise of the converter Q (n_layers,), as the sigma0 of flat ground that returns as much.

    The gain follows the range as the echo of flat ground does, and each channel has its own: the full scale is that
    over the channel's mean echo, with the receiver's noise before pulses are added up. That of a pair together is that
    of both. ``mean`` (n_layers, n_range, n_azimuth), ``noise_w`` and ``calibration_w`` (n_range,) as of `RadarImage`.
    """
    spare = radar.pulses_a_sample
    echo = (mean / calibration_w[:, None]).mean(axis=(1, 2)) + spare * float((noise_w / calibration_w).mean())
    if PHASE in radar.channels:
        echo[len(radar.recorded) :] = echo[[radar.layers.index(channel) for channel in radar.pair]].mean()
    return np.asarray(converter_error(radar.adc_bits, radar.adc_range_db) / spare * echo, dtype=np.float64)


def named_function(field: str, name: str) -> Transfer:
    """A user's function ``package.module:function`` of an array, whose failures are told as what they are.

    In a campaign the module may lie beside ``campaign.toml``.

    Raises
    ------
    ConfigurationError
        It cannot be imported; its own calls raise where it fails or returns something else.
    """
    try:
        function: Transfer = own_function(name)
    except (Exception, SystemExit) as error:  # the user's module may do anything
        text = f"the function cannot be imported: {type(error).__name__}: {error}"
        raise ConfigurationError(text, import_remedy(error), field=field, value=name) from error

    def stage(power: FloatArray) -> FloatArray:
        try:
            with contained():
                out = np.asarray(function(power.copy()), dtype=np.float64)
        except (Exception, SystemExit) as error:
            text = f"the function failed: {type(error).__name__}: {error}"
            raise ConfigurationError(text, "Fix it", field=field, value=name) from error
        if out.shape != power.shape or not np.isfinite(out).all() or bool((out < 0.0).any()):
            text = "the function must return one finite intensity >= 0 for each power"
            raise ConfigurationError(text, "Fix it", field=field, value=name)
        return out

    return stage


def transfer_function(radar: RadarConfiguration, level_w: float) -> Transfer | None:
    """M of a radar's receiver of a level [W], > 0; None of a linear one.

    "square_law": I = P**2 / level; "saturation": I = P up to the level and no further; "compression", of small signals:
    I = P**2 / (P + level), square-law below the level and linear above; "agc": the mean over all ranges, followed along
    the flight over `agc_length_m`, is brought to the level; or a `named_function`, called with the power array.
    """
    match radar.receiver:
        case "linear":
            return None
        case "square_law":
            return lambda p: np.asarray(p * p / level_w)
        case "saturation":
            return lambda p: np.minimum(p, level_w)
        case "compression":
            return lambda p: np.asarray(p * (p / (p + level_w)))
        case "agc":
            return lambda p: _automatic_gain(p, level_w, radar.agc_length_m / radar.pixel_spacing_m)
    return named_function("receiver", radar.receiver)


def _automatic_gain(power: FloatArray, level_w: float, length: float) -> FloatArray:
    """Gain that brings the running mean of the range lines to the level; first-order filter in flight direction."""
    lines = power.mean(axis=-2)
    followed = np.empty_like(lines)
    share = -np.expm1(-1.0 / length)
    state = lines[..., : max(1, round(length))].mean(axis=-1)
    for j in range(lines.shape[-1]):
        state = state + share * (lines[..., j] - state)
        followed[..., j] = state
    gain = level_w / np.where(followed > 0.0, followed, level_w)
    return np.asarray(power * gain[..., None, :])


def picture(image: RadarImage) -> AnyArray:
    """Whole levels (n_channels, n_range, n_azimuth) of the image as the radar's calibration asks for it.

    The final product of the report. Intensity by I_min (eq. 3-16) or by the pair I_C, I_QC (eq. 3-17); else grey tones
    of film density by the pair P_RC, G_RC (eq. 3-18), or with neither so that each channel's median becomes mid-grey.
    """
    radar, bits, decibels = image.radar, image.radar.n_bits, image.radar.dynamic_range_db
    minimum = radar.i_min_w
    if radar.i_c_w is not None and radar.i_qc is not None:
        minimum = least_intensity(radar.i_c_w, radar.i_qc, bits, decibels)
    out = np.empty(image.intensity.shape, dtype=_level_type(bits))
    for levels, plane in zip(out, image.intensity, strict=True):
        if minimum is not None:
            tone = quantised_intensity(plane, minimum, bits, decibels)
        else:
            known_w, known_tone = radar.p_rc_w, radar.g_rc
            if known_w is None or known_tone is None:
                known_w, known_tone = _median(plane), 0.5 * (2.0**bits - 1.0)
            calibration = film_density(np.array([known_w]), radar.film_gamma, radar.film_k)
            # Single precision holds the levels of 8 bits to a thousandth, those of 16 bits not to one half.
            exposure = plane if bits <= 8 else plane.astype(np.float64)
            density = film_density(exposure, radar.film_gamma, radar.film_k)
            tone = greytone(density, float(calibration[0]), float(known_tone), bits, decibels)
        levels[:] = to_levels(tone, bits)
    return out


def _median(plane: AnyArray) -> float:
    """Median of the pixels with power; 1 without any."""
    lit = np.ravel(plane if plane.min() > 0.0 else plane[plane > 0.0])
    if not lit.size:
        return 1.0
    # One partition and the largest of the lower half: numpy.median takes ten times as long.
    half = lit.size // 2
    parted = np.partition(lit, half)
    return float(parted[half] if lit.size % 2 else 0.5 * (parted[half] + parted[:half].max()))


def film_density(intensity_in: AnyArray, gamma: float = 1.0, k: float = 1.0) -> AnyArray:
    """Density of film, D = gamma log10(I) + log10(K): eqs. (3-4) to (3-6), (3-13), (3-14).

    Of the exposure I >= 0, and of its type; zero gives -inf, which the grey tone clips. ``gamma`` > 0 is the slope of
    the linear part of the film's curve, ``k`` > 0 the constant of exposure and development.
    """
    with np.errstate(divide="ignore"):
        density = np.asarray(np.log10(intensity_in))
    density *= gamma
    density += math.log10(k)
    return density


def greytone(
    density: AnyArray,
    calibration_density: float,
    calibration_greytone: float = 0.0,
    n_bits: int = 8,
    dynamic_range_db: float = 20.0,
) -> FloatArray:
    """Grey tone of a film density: eq. (3-18), clipped to 0 .. 2**n - 1 and not yet rounded, see `to_levels`.

    Eq. (3-19) is the same written out; its printed denominator 10**m is m/10, as (3-18) and the worked example show.
    The density is D of `film_density`; -inf (no power at all) becomes 0. The calibration is D_C and the grey tone G_RC
    it is given; n >= 1 are the bits, m > 0 the decibels spread over the grey tones.
    """
    top = 2.0**n_bits - 1.0
    tone = np.asarray(np.asarray(density) - calibration_density)
    tone *= top / (dynamic_range_db / 10.0)
    tone += calibration_greytone
    np.maximum(tone, 0.0, out=tone)
    return np.minimum(tone, top, out=tone)


def quantised_intensity(
    intensity_in: AnyArray, minimum: float, n_bits: int = 8, dynamic_range_db: float = 20.0
) -> FloatArray:
    """Linear quantisation between a least intensity and m decibels above it: eq. (3-16), clipped, not yet rounded.

    Of intensities I_p >= 0, of which I_MIN > 0 becomes 0, by n bits.
    """
    top = 2.0**n_bits - 1.0
    step = top / (10.0 ** (dynamic_range_db / 10.0) - 1.0)
    return np.asarray(np.clip(step * (np.asarray(intensity_in, dtype=np.float64) / minimum - 1.0), 0.0, top))


def least_intensity(calibration: float, level: float, n_bits: int = 8, dynamic_range_db: float = 20.0) -> float:
    """I_MIN of `quantised_intensity` by which the intensity I_C, > 0, has the level I_QC: eq. (3-17)."""
    return float(calibration / (level / (2.0**n_bits - 1.0) * (10.0 ** (dynamic_range_db / 10.0) - 1.0) + 1.0))


def to_levels(tone: AnyArray, n_bits: int = 8) -> AnyArray:
    """Whole levels of a grey tone or quantised intensity, as the smallest unsigned integers that hold them.

    Tones lie within 0 .. 2**n_bits - 1, of 1 to 32 bits; nan becomes 0.
    """
    # Of nan and a number, fmax takes the number.
    level = np.asarray(np.fmax(tone, 0.0))
    np.fmin(level, 2.0**n_bits - 1.0, out=level)
    np.rint(level, out=level)
    return level.astype(_level_type(n_bits))


def _level_type(n_bits: int) -> type[np.unsignedinteger[Any]]:
    return np.uint8 if n_bits <= 8 else np.uint16 if n_bits <= 16 else np.uint32
