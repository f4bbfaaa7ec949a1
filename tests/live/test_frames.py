"""Streams parsed in any pieces, after any noise; no frame with a wrong checksum is accepted."""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

from facets.live import ELECTRODES, XY_SUM, RawSamples, encode, parser

FORMS = ("frames", "cobs", "text")
NAMES = [field.name for field in fields(RawSamples)]


def samples(count, channels=0):
    rng = np.random.default_rng(1)
    seq = np.arange(count, dtype=np.uint32)
    counts = rng.integers(-(2**31), 2**31, (count, 12)).astype(np.int32)
    counts[::3] //= 2**20  # small ones have zeros in their bytes
    kind = np.full(count, ELECTRODES, np.uint8)
    values = rng.normal(size=(count, channels)).astype(np.float32)
    values[1::4] = np.nan
    return RawSamples(kind, 0 * kind, seq, 100 * seq, counts, values)


def parsed(form, pieces, channels=0):
    reader = parser(form, "electrodes", channels)
    parts = [reader.feed(piece) for piece in pieces]
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in NAMES}
    return RawSamples(**joined), reader


def assert_same(samples, expected):
    for name in NAMES:
        np.testing.assert_array_equal(getattr(samples, name), getattr(expected, name))


@pytest.mark.parametrize("form", FORMS)
@given(
    torn=st.integers(0, 80),
    cuts=st.lists(st.integers(0, 3000), max_size=12),
    count=st.integers(0, 30),
    channels=st.sampled_from([0, 1, 2, 15]),
)
@pytest.mark.slow
def test_any_pieces_give_the_same(form, torn, cuts, count, channels):
    """Also where the first frames are torn."""
    sent = samples(count, channels=channels)
    data = encode(form, sent)[torn:]
    ends = sorted({0, len(data), *(cut for cut in cuts if cut < len(data))})
    received, reader = parsed(form, [data[a:b] for a, b in pairwise(ends)] or [b""], channels)
    assert len(received) >= count - 2 * (torn > 0)
    assert_same(received, sent.where(slice(count - len(received), None)))
    assert torn or reader.corrupt == reader.skipped == 0


@pytest.mark.parametrize("form", ["frames", "cobs"])
@given(data=st.data(), channels=st.sampled_from([0, 2]))
def test_noise_costs_the_frames_it_hits_and_no_other(form, data, channels):
    sent = samples(20, channels=channels)
    raw = bytearray(encode(form, sent))
    size = len(raw) // 20
    hit = data.draw(st.integers(1, 18))
    place = hit * size + data.draw(st.integers(0, size - 2))
    fault = data.draw(st.sampled_from(["flip", "lose", "double"]))
    if fault == "flip":
        raw[place] ^= 1 << data.draw(st.integers(0, 7))
    elif fault == "lose":
        del raw[place]
    else:
        raw.insert(place, raw[place])
    received, _ = parsed(form, [bytes(raw)], channels)
    assert_same(received, sent.where(received.seq))  # nothing that was never sent
    assert set(range(20)) - {hit - 1, hit} <= set(received.seq.tolist())


@pytest.mark.parametrize("form", ["frames", "cobs"])
def test_a_stream_is_found_in_rubbish(form):
    rng = np.random.default_rng(4)
    rubbish = rng.integers(0, 256, 5000).astype(np.uint8).tobytes() + b"\0"
    received, reader = parsed(form, [rubbish + encode(form, samples(10)) + b"\xa5\x5a" + rubbish])
    assert received.seq.tolist() == list(range(10))
    assert reader.skipped > 4000


def test_lines_that_are_not_samples_are_counted_and_values_may_lack():
    lines = b"# hello\n1,100" + b",5" * 12 + b"\n2,200,x\n\n3,300" + b",6" * 11 + b"\r\n"
    received, reader = parsed("text", [lines])
    assert received.seq.tolist() == [1]
    assert reader.corrupt == 2
    assert parser("text", "xy-sum").feed(lines).kind.tolist() == [XY_SUM]
    line = b"7,700" + b",1" * 12 + b",0.25,\n"
    received, reader = parsed("text", [line, line.replace(b"0.25", b"1e300"), b"x" + line], 2)
    np.testing.assert_array_equal(received.channels, [[0.25, np.nan], [np.inf, np.nan]])
    assert reader.corrupt == 1


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("sent", "named"), [(0, 2), (3, 2), (15, 0)])
def test_another_number_of_channels_is_never_read(form, sent, named):
    data = encode(form, samples(40, channels=sent))[11:]  # the first frame is torn
    size = max(len(data) // 7, 1)
    pieces = [data[at : at + size] for at in range(0, len(data), size)]
    received, reader = parsed(form, pieces, named)
    assert len(received) == 0
    assert reader.corrupt
