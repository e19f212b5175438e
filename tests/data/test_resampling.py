"""Resampling chunk by chunk against the whole recording at once."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tex_lightning.data.decode import Resampler, to_rate

TRACE = np.random.default_rng(0).standard_normal((3, 9000)) + 9.8


@settings(max_examples=30)
@given(
    source=st.sampled_from([2_000, 2_200, 3_333.3, 8_000, 9_999, 16_000, 22_050, 44_100, 48_000]),
    chunks=st.lists(st.sampled_from([0, 1, 7, 160, 441, 3000]), max_size=9),
    axes=st.sampled_from([1, 3]),
    precision=st.sampled_from([np.float32, np.float64]),
)
def test_chunks_give_what_the_whole_recording_gives(source, chunks, axes, precision):
    trace = TRACE[:axes].astype(precision)
    whole = to_rate(trace, source, 10_000, "it")
    resampler, place, found = Resampler(source, 10_000, "it"), 0, []
    for chunk in [*chunks, 9000]:
        found.append(resampler.push(trace[:, place : place + chunk]))
        place += chunk
        so_far = sum(part.shape[1] for part in found)
        lag = min(place, 9000) / source * 10_000 - so_far
        assert lag <= 10 * max(1, 10_000 / source) + 1
    found.append(resampler.finish())
    together = np.concatenate(found, axis=1)
    assert together.dtype == np.float32
    assert together.shape == whole.shape
    np.testing.assert_allclose(together, whole, rtol=0, atol=2e-5)


def test_what_is_kept_does_not_grow():
    resampler, kept = Resampler(44_100, 10_000, "it"), []
    for _ in range(50):
        resampler.push(TRACE[:1, :4410])
        kept.append(resampler.kept.base is None and resampler.kept.shape[1])
    assert max(kept) < 441 + 2 * 45
    assert Resampler(44_100, 10_000, "it").finish() is None
