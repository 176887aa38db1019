"""Keys and generators of every random number, addressed by what the number is for.

A number is a function of (campaign seed, run id, purpose) and, in the kernels, of the counter of its pixel. It does not
depend on the worker, the order of calls, the number of threads or the platform.
"""

from __future__ import annotations

import hashlib
import operator

import numpy as np

from seqrsm.arrays import AnyArray


def _digest(seed: int, run_id: int, purpose: str, size: int) -> bytes:
    # Decimal text with separators cannot make two different triples equal; blake2b spreads them over the key space.
    text = f"seqrsm|{operator.index(seed)}|{operator.index(run_id)}|{purpose}"
    return hashlib.blake2b(text.encode("utf-8"), digest_size=size).digest()


def stream_key(seed: int, run_id: int, purpose: str) -> tuple[np.uint32, np.uint32]:
    """Key of a Philox4x32-10 stream for the kernels, of any integers: seed of the campaign and run within it.

    The same id gives the same draws; streams of different purposes, such as ``"speckle"``, are unrelated. The key is
    the 64-bit one of Salmon et al. (2011), Parallel random numbers: as easy as 1, 2, 3.
    """
    words: AnyArray = np.frombuffer(_digest(seed, run_id, purpose, 8), dtype="<u4")
    return np.uint32(words[0]), np.uint32(words[1])


def generator(seed: int, run_id: int, purpose: str) -> np.random.Generator:
    """Numpy generator for the draws outside the kernels, keyed as `stream_key`: SFC64 from a 128-bit key.

    Normal draws take 0.7 of the time of Philox, whose counter is not needed here.
    """
    return np.random.Generator(np.random.SFC64(int.from_bytes(_digest(seed, run_id, purpose, 16), "little")))


def batch_seed(seed: int, n_runs: int) -> int:
    """Seed of what is chosen after so many runs of a campaign."""
    return (seed + 7919 * n_runs) % 2**32
