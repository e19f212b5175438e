"""Bytes to samples, wherever they are cut."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.errors import UserError
from tex_lightning.recording.parsing import Float32Parser, TextParser

SAMPLES = np.random.default_rng(0).standard_normal((3, 40)).astype(np.float32)


def parse(parser, content, cuts=()):
    ends = [0, *sorted(cuts), len(content)]
    pieces = [content[start:end] for start, end in pairwise(ends)]
    found = [parser.feed(piece) for piece in pieces]
    parser.end()
    return np.concatenate(found, axis=1)


def lines(samples, mark=","):
    return "".join(mark.join(map(repr, row)) + "\r\n" for row in samples.T.tolist()).encode()


@given(st.lists(st.integers(0, SAMPLES.nbytes), max_size=6))
def test_float32_is_what_was_sent_wherever_it_is_cut(cuts):
    content = SAMPLES.T.astype("<f4").tobytes()
    parser = Float32Parser("haptic=-", "record.haptic", 3)
    np.testing.assert_array_equal(parse(parser, content, cuts), SAMPLES)


@given(st.lists(st.integers(0, len(lines(SAMPLES))), max_size=6), st.sampled_from(",; \t"))
def test_text_is_what_was_sent_wherever_it_is_cut(cuts, mark):
    parser = TextParser("haptic=-", "record.haptic", 3)
    np.testing.assert_array_equal(parse(parser, lines(SAMPLES, mark), cuts), SAMPLES)


def test_remarks_empty_lines_and_a_line_that_we_came_into_are_passed_over():
    parser = TextParser("haptic=-", "record.haptic", 1, cut=True)
    assert parse(parser, b"345\n# ready\n\n1.5\n-2e-3\n").tolist() == [[1.5, np.float32(-2e-3)]]


@pytest.mark.parametrize(
    ("kind", "axes", "content", "said"),
    [
        (TextParser, 3, b"1,2,3\n1,2\n", "line 2: '1,2' has 2 numbers; print a line with 3"),
        (TextParser, 1, b"1\nready\n", "line 2: 'ready' is no number"),
        (TextParser, 1, b"nan\n", "sends NaN, infinity or a number beyond 1e\\+09 at sample 0"),
        (TextParser, 1, b"\x01" * 2000, "no lines of text; set record.haptic.format=float32"),
        (Float32Parser, 1, b"0.125\n0.25\n", "sends text, .*; set record.haptic.format=text"),
        (Float32Parser, 3, bytes(20), "ends within a sample; send 3 little-endian float32"),
        (Float32Parser, 1, bytes(4) + b"\xff" * 4, "NaN, infinity .* at sample 1"),
    ],
)
def test_what_cannot_be_meant_is_refused(kind, axes, content, said):
    with pytest.raises(UserError, match=said):
        parse(kind("haptic=-", "record.haptic", axes), content)
