"""Tells PoCL what processor it runs on, where it does not know or is mistaken.

PoCL asks LLVM for the name of the processor. LLVM calls what came out after it "generic", and its own compiler then
refuses that name: on such a machine the PoCL that pip brings (3.0, with LLVM 14) builds nothing. Or it takes a
successor for what it knows: a Zen 4 for a Zen 3, which has no AVX-512. PoCL's library of functions is that of the
widest registers there are, and its compiler crashes where the name does not have them. Or a virtual machine hides what
the name promises. Later ones take a name by the processor's features, as is done here, or read it from
POCL_LLVM_CPU_NAME.

The name cannot be told by way of OpenCL. But the device's record, which is what an OpenCL device points at, holds two
pointers to text one after the other: to what kind of system it is (x86_64-…) and to the processor's name. The second is
pointed at another name, and nothing else is touched. Where there is no such pair, or more than one, all is left as it
is.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Set
from typing import Any

RECORD_BYTES = 1024
"""How much of the record is looked at; the pair is at byte 632 of PoCL 3.0-rc2's, which is larger than this."""
_SYSTEM = b"x86_64-"
_WORD = struct.calcsize("P")

_AVX = frozenset({"avx", "cx16", "popcnt", "sse4_2"})
_AVX2 = _AVX | {"avx2", "fma", "f16c", "bmi1", "bmi2", "abm", "movbe"}
_AVX512 = _AVX2 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
_NAMES = {"avx512f": ("skylake-avx512", _AVX512), "avx2": ("haswell", _AVX2), "avx": ("sandybridge", _AVX)}
"""By the widest registers there are: a processor that has them, and what else it has that compilers make use of."""
_WIDEST = {
    "avx512f": "skylake-avx512 cascadelake cooperlake cannonlake icelake-client icelake-server rocketlake tigerlake "
    "sapphirerapids knl knm",
    "avx2": "haswell broadwell skylake alderlake bdver4 znver1 znver2 znver3",
    "avx": "sandybridge ivybridge bdver1 bdver2 bdver3 btver2",
}
"""The names that LLVM 14 gives, by the widest registers that it takes each to have."""
_PROMISED = {name: widest for widest, names in _WIDEST.items() for name in names.split()}


def known_name(features: Set[str]) -> str | None:
    """Return what a processor of these features is called by compilers that do not know it; None if nothing fits.

    Args:
        features: as the flags in Linux' /proc/cpuinfo are spelled.
    """
    for widest, (name, needed) in _NAMES.items():
        if widest in features:
            return name if needed <= features else None
    return "x86-64" if "lm" in features else None


def name_processor(device: Any, features: Set[str]) -> str | None:
    """Tell PoCL the processor's name if what it has does not fit; returns the name told, or None where nothing was.

    Args:
        device: a ``pyopencl.Device`` of PoCL, with which nothing was built so far.
        features: of the processor, as in `known_name`.
    """
    name = known_name(features)
    places = _places_of_name(device.int_ptr, features)
    if name is None or len(places) != 1:
        return None
    text = ctypes.CDLL(None).strdup
    text.restype = ctypes.c_void_p  # for PoCL to free, as what it had before
    ctypes.c_void_p.from_address(places[0]).value = text(name.encode())
    return name


def _places_of_name(record: int, features: Set[str]) -> list[int]:
    """Return where a record points at a name that does not fit; nothing where memory cannot be looked at."""
    try:
        # Words that are no pointers are refused there, and not read.
        with open("/proc/self/mem", "rb", buffering=0) as memory:
            words = struct.unpack(f"{RECORD_BYTES // _WORD}P", _bytes_at(memory, record, RECORD_BYTES))
            texts = [_bytes_at(memory, word, 16) for word in words]
    except (OSError, struct.error):
        return []
    return [
        record + k * _WORD
        for k in range(1, len(words))
        if b"\0" in texts[k] and _misleads(texts[k].split(b"\0")[0], features) and texts[k - 1].startswith(_SYSTEM)
    ]


def _misleads(name: bytes, features: Set[str]) -> bool:
    """Return whether a name is none, or has other registers than a processor of these features."""
    known = name.decode("latin1")
    widest = next((each for each in _NAMES if each in features), None)
    return known == "generic" or _PROMISED.get(known, widest) != widest


def _bytes_at(memory: Any, address: int, count: int) -> bytes:
    """Return so many bytes from an address on, or fewer where memory ends; none where there is no memory."""
    try:
        memory.seek(address)
        found: bytes = memory.read(count)
        return found
    except (OSError, OverflowError, ValueError):
        return b""
