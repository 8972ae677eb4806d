"""What PoCL is told of a processor that it does not know, and that nothing else is touched."""

import ctypes
import struct
from types import SimpleNamespace

import pytest

from clsim.opencl.processor import RECORD_BYTES, known_name, name_processor

ZEN_5 = {"lm", "cx16", "sse4_2", "movbe", "popcnt", "avx", "f16c", "fma", "abm", "bmi1", "bmi2", "avx2", "gfni"} | {
    f"avx512{part}" for part in ("f", "dq", "ifma", "cd", "bw", "vl", "_bf16", "vbmi", "_vbmi2")
}
"""A part of the flags that Linux tells of an EPYC 9005."""
WITHOUT_AVX512 = {flag for flag in ZEN_5 if not flag.startswith("avx512")}


@pytest.mark.parametrize(
    ("features", "name"),
    [
        (ZEN_5, "skylake-avx512"),
        (WITHOUT_AVX512, "haswell"),
        (WITHOUT_AVX512 - {"avx2", "fma"}, "sandybridge"),
        ({"lm", "sse4_2"}, "x86-64"),
        # Wide registers, but not what else compilers use where they are: nothing fits.
        (ZEN_5 - {"avx512vl"}, None),
        (WITHOUT_AVX512 - {"fma"}, None),
        (set(), None),
    ],
)
def test_the_name_follows_the_features(features: set[str], name: str | None) -> None:
    assert known_name(features) == name


class Record:
    """Memory that looks like a device's record."""

    def __init__(self, *texts: bytes | None) -> None:
        self.texts = [text and ctypes.create_string_buffer(text) for text in texts]
        self.words = [7, 0, 2**63, 2**64 - 1, *(ctypes.addressof(text) if text else 0 for text in self.texts)]
        size = RECORD_BYTES // 8
        self.memory = (ctypes.c_uint64 * size)(*self.words, *[0] * (size - len(self.words)))
        self.device = SimpleNamespace(int_ptr=ctypes.addressof(self.memory))

    def named(self) -> list[bytes]:
        """Return the texts that are pointed at now."""
        return [ctypes.string_at(self.memory[k]) for k in range(4, len(self.words)) if self.memory[k]]

    def content(self) -> bytes:
        return bytes(self.memory)


def test_the_pointer_to_the_name_alone_is_changed() -> None:
    record = Record(b"pthread", b"generic", b"x86_64-unknown-linux-gnu", b"generic", b"generic")
    before = record.content()
    assert name_processor(record.device, ZEN_5) == "skylake-avx512"
    assert record.named() == [b"pthread", b"generic", b"x86_64-unknown-linux-gnu", b"skylake-avx512", b"generic"]
    changed = [k for k, (a, b) in enumerate(zip(before, record.content(), strict=True)) if a != b]
    assert changed and {k // 8 for k in changed} == {7}
    assert struct.unpack_from("4Q", record.content()) == (7, 0, 2**63, 2**64 - 1)


@pytest.mark.parametrize(
    ("name", "features", "told"),
    [
        # LLVM 14 takes a Zen 4 for a Zen 3, which has no AVX-512; PoCL's library uses it, and its compiler crashed.
        (b"znver3", ZEN_5, "skylake-avx512"),
        (b"znver3", WITHOUT_AVX512, None),
        # Virtual machines hide features, and not the model.
        (b"icelake-server", WITHOUT_AVX512, "haswell"),
        (b"skylake", {"lm", "sse4_2"}, "x86-64"),
        (b"icelake-server", ZEN_5, None),
        (b"core2", ZEN_5, None),
    ],
)
def test_a_name_that_promises_other_registers_than_there_are_is_replaced(name, features, told) -> None:
    record = Record(b"x86_64-unknown-linux-gnu", name)
    assert name_processor(record.device, features) == told
    assert record.named()[1] == (told.encode() if told else name)


@pytest.mark.parametrize(
    "texts",
    [
        (b"x86_64-unknown-linux-gnu", b"znver4"),
        (b"x86_64-unknown-linux-gnu", b"generic-x"),
        (b"aarch64-unknown-linux-gnu", b"generic"),
        (b"x86_64-unknown-linux-gnu", None, b"generic"),
        (b"generic",),
        (b"x86_64-a", b"generic", b"x86_64-b", b"generic"),
        (),
    ],
)
def test_what_looks_different_is_left_as_it_is(texts: tuple[bytes | None, ...]) -> None:
    record = Record(*texts)
    before = record.content()
    assert name_processor(record.device, ZEN_5) is None
    assert record.content() == before


def test_a_processor_that_nothing_fits_is_not_named() -> None:
    record = Record(b"x86_64-unknown-linux-gnu", b"generic")
    before = record.content()
    assert name_processor(record.device, set()) is None
    assert record.content() == before


def test_a_device_that_is_no_memory_is_left_alone() -> None:
    assert name_processor(SimpleNamespace(int_ptr=8), ZEN_5) is None
