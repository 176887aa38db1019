"""Receiver, quantiser and film of the report: from received power to intensity, density and grey tone.

M, Q and S of RSL TR 380-1 eqs. (3-1) to (3-3) are functions of power arrays. None stands for a linear one that changes
nothing, and costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.errors import ConfigurationError, Problem

Transfer = Callable[[FloatArray], FloatArray]
"""Transfer function of one stage: power or intensity in, intensity out, both >= 0."""


def intensity(
    power_w: AnyArray,
    receiver: Transfer | None = None,
    quantiser: Transfer | None = None,
    processing: Transfer | None = None,
) -> FloatArray:
    """Intensity after receiver M, converter Q and processing S: eqs. (3-1) to (3-3), (3-7) and (3-15).

    Parameters
    ----------
    power_w : float array
        Received power with fading [W].
    receiver, quantiser, processing : callable, optional
        M, Q and S; any function, linear or not. None leaves its input.

    Returns
    -------
    float64 array, shape of `power_w`
    """
    out = np.asarray(power_w, dtype=np.float64)
    for stage in (receiver, quantiser, processing):
        if stage is not None:
            out = stage(out)
    return out


def film_density(intensity_in: AnyArray, gamma: float = 1.0, k: float = 1.0) -> FloatArray:
    """Density of film, D = gamma log10(I) + log10(K): eqs. (3-4) to (3-6), (3-13), (3-14).

    Parameters
    ----------
    intensity_in : float array
        Exposure I, >= 0; zero gives -inf, which the grey tone clips.
    gamma : float
        Slope of the linear part of the film's curve, > 0.
    k : float
        Constant of exposure and development, > 0.

    Returns
    -------
    float64 array

    Raises
    ------
    ConfigurationError
        `gamma` or `k` is not positive.
    """
    _refuse_nonpositive(gamma=gamma, k=k)
    with np.errstate(divide="ignore"):
        return np.asarray(gamma * np.log10(np.asarray(intensity_in, dtype=np.float64)) + np.log10(k))


def greytone(
    density: AnyArray,
    calibration_density: float,
    calibration_greytone: float = 0.0,
    n_bits: int = 8,
    dynamic_range_db: float = 20.0,
) -> FloatArray:
    """Grey tone of a film density: eq. (3-18), clipped to 0 .. 2**n - 1 and not yet rounded.

    Eq. (3-19) is the same written out; its printed denominator 10**m is m/10, as (3-18) and the worked example show.

    Parameters
    ----------
    density : float array
        D of `film_density`; -inf (no power at all) becomes 0.
    calibration_density, calibration_greytone : float
        D_C and the grey tone G_RC it is given.
    n_bits : int
        n, >= 1.
    dynamic_range_db : float
        m, the decibels spread over the grey tones, > 0.

    Returns
    -------
    float64 array
        Round it with `to_levels` for an image.

    Raises
    ------
    ConfigurationError
        `n_bits` or `dynamic_range_db` is not positive.
    """
    _refuse_nonpositive(n_bits=n_bits, dynamic_range_db=dynamic_range_db)
    top = 2.0**n_bits - 1.0
    tone = calibration_greytone + top / (dynamic_range_db / 10.0) * (np.asarray(density) - calibration_density)
    return np.asarray(np.clip(tone, 0.0, top))


def quantised_intensity(
    intensity_in: AnyArray, minimum: float, n_bits: int = 8, dynamic_range_db: float = 20.0
) -> FloatArray:
    """Linear quantisation between a least intensity and m decibels above it: eq. (3-16), clipped, not yet rounded.

    Parameters
    ----------
    intensity_in : float array
        I_p, >= 0.
    minimum : float
        I_MIN, the intensity that becomes 0, > 0.
    n_bits : int
        n.
    dynamic_range_db : float
        m.

    Returns
    -------
    float64 array

    Raises
    ------
    ConfigurationError
        `minimum`, `n_bits` or `dynamic_range_db` is not positive.
    """
    _refuse_nonpositive(minimum=minimum, n_bits=n_bits, dynamic_range_db=dynamic_range_db)
    top = 2.0**n_bits - 1.0
    step = top / (10.0 ** (dynamic_range_db / 10.0) - 1.0)
    return np.asarray(np.clip(step * (np.asarray(intensity_in, dtype=np.float64) / minimum - 1.0), 0.0, top))


def quantised_intensity_calibrated(
    intensity_in: AnyArray,
    calibration: float,
    calibration_level: float,
    n_bits: int = 8,
    dynamic_range_db: float = 20.0,
) -> FloatArray:
    """Linear quantisation through one calibrated pair: eq. (3-17), clipped, not yet rounded.

    Parameters
    ----------
    intensity_in : float array
        I_p, >= 0.
    calibration : float
        I_C, > 0.
    calibration_level : float
        I_QC, the level given to I_C.
    n_bits : int
        n.
    dynamic_range_db : float
        m.

    Returns
    -------
    float64 array

    Raises
    ------
    ConfigurationError
        `calibration`, `n_bits` or `dynamic_range_db` is not positive.
    """
    _refuse_nonpositive(calibration=calibration, n_bits=n_bits, dynamic_range_db=dynamic_range_db)
    top = 2.0**n_bits - 1.0
    step = top / (10.0 ** (dynamic_range_db / 10.0) - 1.0)
    scaled = np.asarray(intensity_in, dtype=np.float64) / calibration * (calibration_level / step + 1.0)
    return np.asarray(np.clip(step * (scaled - 1.0), 0.0, top))


def to_levels(tone: AnyArray, n_bits: int = 8) -> AnyArray:
    """Whole levels of a grey tone or quantised intensity, as the smallest unsigned integers that hold them.

    Parameters
    ----------
    tone : float array
        Within 0 .. 2**n_bits - 1; nan becomes 0.
    n_bits : int
        1 to 32.

    Returns
    -------
    uint8, uint16 or uint32 array
    """
    dtype = np.uint8 if n_bits <= 8 else np.uint16 if n_bits <= 16 else np.uint32
    return np.asarray(np.rint(np.clip(np.nan_to_num(tone, nan=0.0), 0.0, 2.0**n_bits - 1.0)), dtype=dtype)


def _refuse_nonpositive(**values: float) -> None:
    problems = [
        Problem("must be above zero", "Give a positive number", field=name, value=value)
        for name, value in values.items()
        if not value > 0.0
    ]
    if problems:
        raise ConfigurationError(*problems)
